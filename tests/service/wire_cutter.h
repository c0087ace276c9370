// A TCP relay that can be cut: how a client looks that vanished.
#pragma once

#include <atomic>
#include <string>
#include <thread>

namespace candela::testing {

// Relays one connection to 127.0.0.1:`port`.
class WireCutter {
 public:
  explicit WireCutter(const std::string& server_address);
  ~WireCutter();

  const std::string& address() const { return address_; }
  // Both connections end at once, with a reset.
  void cut();

 private:
  void run(int server_port);

  int listener_ = -1;
  std::string address_;
  std::atomic<bool> cut_ = false;
  std::thread thread_;
};

}  // namespace candela::testing
