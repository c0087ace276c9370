// Another program that opens a session's name.
#pragma once

#include <memory>
#include <string>

#include "tests/simulator/server.h"

namespace candela::testing {

class Intruder final : public Process {
 public:
  // With a `token` it takes the session over. It stays for `stay`.
  Intruder(Network& network, SimulatedServer& server, const std::string& session,
           const v1::Settings& settings, const std::string& token, absl::Duration stay);

  bool ended() const { return call_ == nullptr; }

 private:
  void react() override {}
  void on_event(CallEvent event);

  v1::StreamRequest open_;
  std::unique_ptr<ClientCall> call_;
  bool asked_ = false;
};

}  // namespace candela::testing
