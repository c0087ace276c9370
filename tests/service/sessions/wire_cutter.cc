#include "tests/service/sessions/wire_cutter.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>

#include "absl/time/clock.h"

namespace candela::testing {
namespace {

sockaddr_in loopback(int port) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<uint16_t>(port));
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  return address;
}

void reset(int socket) {
  const linger now{1, 0};
  setsockopt(socket, SOL_SOCKET, SO_LINGER, &now, sizeof(now));
  close(socket);
}

// One direction.
class Lane {
 public:
  Lane(int from, int to, const std::atomic<double>& bytes_per_second)
      : from_(from), to_(to), bytes_per_second_(bytes_per_second) {}

  // Waits for bytes only while the limit allows some to pass.
  pollfd awaited() {
    const absl::Time now = absl::Now();
    const double rate = bytes_per_second_;
    // Never more than it takes to keep up between two calls.
    may_pass_ = std::min(may_pass_ + rate * absl::ToDoubleSeconds(now - earned_), std::max(1.0, rate / 10));
    earned_ = now;
    return {may_pass_ >= 1 ? from_ : -1, POLLIN, 0};
  }

  // Returns how many bytes passed, or 0 when either end has ended.
  size_t pass() {
    const size_t most = std::min(bytes_.size(), static_cast<size_t>(may_pass_));
    const ssize_t size = recv(from_, bytes_.data(), most, 0);
    if (size <= 0 || send(to_, bytes_.data(), static_cast<size_t>(size), MSG_NOSIGNAL) != size) return 0;
    may_pass_ -= static_cast<double>(size);
    return static_cast<size_t>(size);
  }

 private:
  const int from_;
  const int to_;
  const std::atomic<double>& bytes_per_second_;
  double may_pass_ = 0;  // bytes
  absl::Time earned_ = absl::Now();
  std::array<char, 65536> bytes_;
};

}  // namespace

WireCutter::WireCutter(const std::string& server_address) : listener_(socket(AF_INET, SOCK_STREAM, 0)) {
  sockaddr_in address = loopback(0);
  bind(listener_, reinterpret_cast<sockaddr*>(&address), sizeof(address));
  listen(listener_, 1);
  socklen_t size = sizeof(address);
  getsockname(listener_, reinterpret_cast<sockaddr*>(&address), &size);
  address_ = "127.0.0.1:" + std::to_string(ntohs(address.sin_port));
  const int server_port = std::stoi(server_address.substr(server_address.rfind(':') + 1));
  thread_ = std::thread([this, server_port] { run(server_port); });
}

WireCutter::~WireCutter() {
  cut_ = true;
  if (thread_.joinable()) thread_.join();
  close(listener_);
}

void WireCutter::cut() {
  cut_ = true;
  thread_.join();
}

void WireCutter::run(int server_port) {
  pollfd incoming{listener_, POLLIN, 0};
  while (poll(&incoming, 1, 10) == 0) {
    if (cut_) return;
  }
  const int client = accept(listener_, nullptr, nullptr);
  const int server = socket(AF_INET, SOCK_STREAM, 0);
  const int buffer_bytes = 1 << 16;  // what lies in it is on neither side
  setsockopt(server, SOL_SOCKET, SO_RCVBUF, &buffer_bytes, sizeof(buffer_bytes));
  const sockaddr_in address = loopback(server_port);
  connect(server, reinterpret_cast<const sockaddr*>(&address), sizeof(address));
  Lane to_server(client, server, to_server_);
  Lane to_client(server, client, to_client_);
  while (!cut_) {
    std::array<pollfd, 2> ends{to_server.awaited(), to_client.awaited()};
    if (poll(ends.data(), ends.size(), 10) <= 0) continue;
    if (ends[0].revents != 0 && to_server.pass() == 0) break;
    if (ends[1].revents == 0) continue;
    const size_t passed = to_client.pass();
    if (passed == 0) break;
    bytes_to_client_ += passed;
  }
  reset(client);
  reset(server);
}

}  // namespace candela::testing
