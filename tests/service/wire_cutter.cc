#include "tests/service/wire_cutter.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>

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

// False when `from` has ended.
bool relay(int from, int to) {
  std::array<char, 65536> bytes;
  const ssize_t size = recv(from, bytes.data(), bytes.size(), 0);
  return size > 0 && send(to, bytes.data(), static_cast<size_t>(size), MSG_NOSIGNAL) == size;
}

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
  const sockaddr_in address = loopback(server_port);
  connect(server, reinterpret_cast<const sockaddr*>(&address), sizeof(address));
  std::array<pollfd, 2> ends{pollfd{client, POLLIN, 0}, pollfd{server, POLLIN, 0}};
  while (!cut_) {
    if (poll(ends.data(), ends.size(), 10) <= 0) continue;
    if (ends[0].revents != 0 && !relay(client, server)) break;
    if (ends[1].revents != 0 && !relay(server, client)) break;
  }
  reset(client);
  reset(server);
}

}  // namespace candela::testing
