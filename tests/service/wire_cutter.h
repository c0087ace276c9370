// A TCP relay that can be cut and slowed down: how a client looks that vanished, or that has next to no line.
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
  // From now on no more than so many bytes a second get through to that side; what does not stays with the
  // sender, but for TCP's buffers.
  void slow_to_server(double bytes_per_second) { to_server_ = bytes_per_second; }
  void slow_to_client(double bytes_per_second) { to_client_ = bytes_per_second; }
  // Both connections end at once, with a reset.
  void cut();

 private:
  static constexpr double kUnlimited = 1e15;

  void run(int server_port);

  int listener_ = -1;
  std::string address_;
  std::atomic<bool> cut_ = false;
  std::atomic<double> to_server_ = kUnlimited;
  std::atomic<double> to_client_ = kUnlimited;
  std::thread thread_;
};

}  // namespace candela::testing
