// A server as it is shipped, from its calls to its render loop, without gRPC, threads and a device.
#pragma once

#include <memory>
#include <optional>
#include <string>

#include "absl/status/statusor.h"
#include "client/panorama.h"
#include "server/rpc/service_state.h"
#include "tests/simulator/link.h"

namespace candela::testing {

struct ServerPlan {
  uint32_t max_sessions = 100;
  uint32_t max_frames_in_flight = 3;
  uint64_t memory_bytes = uint64_t{1} << 24;
  uint64_t environment_bytes = uint64_t{1} << 30;
  absl::Duration idle_timeout = absl::Seconds(60);
  absl::Duration clock_offset = absl::ZeroDuration();
  double clock_drift = 0;
};

// A server's address, and one process after another that serves it.
class SimulatedServer {
 public:
  // They outlive it. `keys` are those of its tokens.
  SimulatedServer(Network& network, std::string name, const ServerPlan& plan, const TokenKeys& keys);
  ~SimulatedServer();

  void start();
  // As by SIGKILL. Fails if the process still holds anything when all of its calls have ended.
  absl::Status kill();
  const std::string& name() const { return name_; }

  // Faults of the process that runs; nothing happens without one.
  void stop();
  void go_on();
  void drain(absl::Duration timeout);  // then it ends and starts again
  void lose_device(absl::Duration until_next);
  void hang_device(absl::Duration time);
  void set_clock(absl::Duration by);

  Listener listener();
  absl::StatusOr<v1::Environment> put(const Panorama& panorama);
  // What a process that ended by itself still held.
  const absl::Status& left_behind() const { return left_behind_; }

 private:
  class ProcessTimers;
  class Life;

  absl::Status check_drain(absl::Duration time) const;

  Network& network_;
  World& world_;
  const std::string name_;
  const ServerPlan plan_;
  const TokenKeys& keys_;
  std::shared_ptr<Life> life_;
  absl::Status left_behind_;
};

// Another program that opens a session's name.
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
