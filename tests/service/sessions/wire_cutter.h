// A TCP relay that can be cut or slowed down. It imitates a client that vanishes or has a slow connection.
#pragma once

#include <atomic>
#include <cstdint>
#include <string>
#include <thread>

namespace candela::testing {

// Relays one connection to 127.0.0.1:`port`.
class WireCutter {
 public:
  explicit WireCutter(const std::string& server_address);
  ~WireCutter();

  const std::string& address() const { return address_; }
  // From now on relays at most this many bytes a second to that side. The rest stays with the sender, except
  // for TCP's buffers.
  void slow_to_server(double bytes_per_second) { to_server_ = bytes_per_second; }
  void slow_to_client(double bytes_per_second) { to_client_ = bytes_per_second; }
  // That it has relayed.
  uint64_t bytes_to_client() const { return bytes_to_client_; }
  // Ends both connections at once with a reset.
  void cut();

 private:
  static constexpr double kUnlimited = 1e15;

  void run(int server_port);

  int listener_ = -1;
  std::string address_;
  std::atomic<bool> cut_ = false;
  std::atomic<double> to_server_ = kUnlimited;
  std::atomic<double> to_client_ = kUnlimited;
  std::atomic<uint64_t> bytes_to_client_ = 0;
  std::thread thread_;
};

}  // namespace candela::testing
