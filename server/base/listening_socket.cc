#include "server/base/listening_socket.h"

#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/strip.h"
#include "server/base/address.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

constexpr int kBacklog = 4096;  // the kernel lowers it to net.core.somaxconn

absl::Status cannot(absl::string_view option, const std::string& address, const std::string& why) {
  return absl::UnavailableError(
      absl::StrFormat("cannot %s on %s: %s", option == "metrics" ? "serve metrics" : "listen", address, why));
}

std::string why(absl::string_view option, int error) {
  if (error == EADDRINUSE) {
    return absl::StrFormat("the address is in use; stop the program that listens there or pass another --%s",
                           option);
  }
  if (error == EADDRNOTAVAIL) {
    return absl::StrFormat("the address does not belong to this machine; pass another --%s", option);
  }
  return absl::StrFormat("%s; pass another --%s", std::strerror(error), option);
}

sockaddr_storage local_address(int descriptor) {
  sockaddr_storage address{};
  socklen_t size = sizeof address;
  getsockname(descriptor, reinterpret_cast<sockaddr*>(&address), &size);
  return address;
}

uint16_t port_of(const sockaddr_storage& address) {
  return ntohs(address.ss_family == AF_INET ? reinterpret_cast<const sockaddr_in&>(address).sin_port
                                            : reinterpret_cast<const sockaddr_in6&>(address).sin6_port);
}

void set_port(sockaddr* address, uint16_t port) {
  if (address->sa_family == AF_INET) reinterpret_cast<sockaddr_in*>(address)->sin_port = htons(port);
  if (address->sa_family == AF_INET6) reinterpret_cast<sockaddr_in6*>(address)->sin6_port = htons(port);
}

// The socket, or -1 and errno.
int listen_at(const sockaddr* at, socklen_t size) {
  const int descriptor = socket(at->sa_family, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  if (descriptor < 0) return -1;
  const int on = 1;
  const int off = 0;
  if (at->sa_family != AF_UNIX) {
    // Connections inherit TCP_NODELAY. A server that restarts does not wait for the connections of the last.
    setsockopt(descriptor, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
    setsockopt(descriptor, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
  }
  if (at->sa_family == AF_INET6) setsockopt(descriptor, IPPROTO_IPV6, IPV6_V6ONLY, &off, sizeof off);
  if (bind(descriptor, at, size) == 0 && ::listen(descriptor, kBacklog) == 0) return descriptor;
  const int error = errno;
  close(descriptor);
  errno = error;
  return -1;
}

int listen_everywhere(uint32_t port) {
  sockaddr_in6 six{};
  six.sin6_family = AF_INET6;
  six.sin6_port = htons(static_cast<uint16_t>(port));
  const int both = listen_at(reinterpret_cast<const sockaddr*>(&six), sizeof six);
  if (both >= 0 || errno == EADDRINUSE || errno == EACCES) return both;
  sockaddr_in four{};  // a machine without IPv6
  four.sin_family = AF_INET;
  four.sin_port = six.sin6_port;
  return listen_at(reinterpret_cast<const sockaddr*>(&four), sizeof four);
}

// One socket for each address of the host.
absl::StatusOr<std::vector<int>> listen_on_name(absl::string_view option, const std::string& address,
                                                const HostPort& at) {
  addrinfo wanted{};
  wanted.ai_flags = AI_PASSIVE | AI_NUMERICSERV;
  wanted.ai_socktype = SOCK_STREAM;
  addrinfo* found = nullptr;
  const int failed =
      getaddrinfo(std::string(at.host).c_str(), absl::StrCat(at.port).c_str(), &wanted, &found);
  if (failed != 0) {
    return cannot(option, address, absl::StrCat(gai_strerror(failed), "; name an address of this machine"));
  }
  const std::unique_ptr<addrinfo, decltype(&freeaddrinfo)> list(found, freeaddrinfo);
  std::vector<int> sockets;
  int error = 0;
  for (addrinfo* one = found; one != nullptr; one = one->ai_next) {
    if (!sockets.empty()) set_port(one->ai_addr, port_of(local_address(sockets.front())));
    const int descriptor = listen_at(one->ai_addr, one->ai_addrlen);
    if (descriptor >= 0) sockets.push_back(descriptor);
    if (descriptor < 0 && error != EADDRINUSE) error = errno;
  }
  // An address that this machine lacks, as ::1 without IPv6, is left out. One that is taken is not.
  if (!sockets.empty() && error != EADDRINUSE) return sockets;
  for (const int descriptor : sockets) close(descriptor);
  return cannot(option, address, why(option, error));
}

absl::StatusOr<std::vector<int>> listen_on_tcp(absl::string_view option, const std::string& address) {
  const std::optional<HostPort> at = parse_host_port(address);
  if (!at) return cannot(option, address, "it is not HOST:PORT");
  if (at->host != "0.0.0.0" && at->host != "::") return listen_on_name(option, address, *at);
  const int descriptor = listen_everywhere(at->port);
  if (descriptor < 0) return cannot(option, address, why(option, errno));
  return std::vector<int>{descriptor};
}

// Removes the socket of a process that has ended. UNAVAILABLE if there is a file, or a socket that is served.
absl::Status make_room(absl::string_view option, const std::string& address, const sockaddr_un& at) {
  struct stat info {};
  if (lstat(at.sun_path, &info) != 0) return absl::OkStatus();
  if (!S_ISSOCK(info.st_mode)) {
    return cannot(option, address,
                  "a file with that name exists and is not a socket; remove it or pass another --listen");
  }
  const int probe = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  const bool served = probe >= 0 && (connect(probe, reinterpret_cast<const sockaddr*>(&at), sizeof at) == 0 ||
                                     errno == EAGAIN);
  if (probe >= 0) close(probe);
  if (served) return cannot(option, address, why(option, EADDRINUSE));
  unlink(at.sun_path);
  return absl::OkStatus();
}

absl::StatusOr<int> listen_on_file(absl::string_view option, const std::string& address,
                                   const std::string& path) {
  sockaddr_un at{};
  at.sun_family = AF_UNIX;
  if (path.size() >= sizeof at.sun_path) {
    return cannot(
        option, address,
        absl::StrFormat("the path has %d bytes and a socket's path has at most %d; pass a shorter one",
                        path.size(), sizeof at.sun_path - 1));
  }
  std::memcpy(at.sun_path, path.data(), path.size());
  RETURN_IF_ERROR(make_room(option, address, at));
  const int descriptor = listen_at(reinterpret_cast<const sockaddr*>(&at), sizeof at);
  if (descriptor < 0) return cannot(option, address, why(option, errno));
  return descriptor;
}

// Replaces "any address" by loopback.
void make_reachable(sockaddr_storage& address) {
  if (address.ss_family == AF_INET) {
    auto& four = reinterpret_cast<sockaddr_in&>(address);
    if (four.sin_addr.s_addr == INADDR_ANY) four.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  } else if (address.ss_family == AF_INET6) {
    auto& six = reinterpret_cast<sockaddr_in6&>(address);
    // ::ffff:127.0.0.1, because a machine may have no ::1.
    if (IN6_IS_ADDR_UNSPECIFIED(&six.sin6_addr)) {
      six.sin6_addr.s6_addr[10] = six.sin6_addr.s6_addr[11] = 0xff;
      six.sin6_addr.s6_addr[12] = 127;
      six.sin6_addr.s6_addr[15] = 1;
    }
  }
}

}  // namespace

absl::StatusOr<std::vector<ListeningSocket>> ListeningSocket::listen(absl::string_view option,
                                                                     const std::string& address) {
  std::vector<ListeningSocket> sockets;
  absl::string_view path = address;
  if (absl::ConsumePrefix(&path, "unix:")) {
    if (absl::StartsWith(path, "//")) path.remove_prefix(2);
    ASSIGN_OR_RETURN(const int descriptor, listen_on_file(option, address, std::string(path)));
    sockets.push_back(ListeningSocket(descriptor, address, std::string(path)));
    return sockets;
  }
  ASSIGN_OR_RETURN(const std::vector<int> descriptors, listen_on_tcp(option, address));
  for (const int descriptor : descriptors) sockets.push_back(ListeningSocket(descriptor, address, ""));
  return sockets;
}

ListeningSocket::ListeningSocket(int descriptor, const std::string& address, std::string file)
    : descriptor_(descriptor), address_(address), file_(std::move(file)), local_(local_address(descriptor)) {
  if (!file_.empty()) return;
  address_ = absl::StrCat(address.substr(0, address.rfind(':') + 1), port_of(local_));
  make_reachable(local_);
}

ListeningSocket::ListeningSocket(ListeningSocket&& other) noexcept
    : descriptor_(std::exchange(other.descriptor_, -1)),
      address_(std::move(other.address_)),
      file_(std::move(other.file_)),
      local_(other.local_) {
  other.file_.clear();
}

ListeningSocket::~ListeningSocket() {
  if (descriptor_ < 0) return;
  if (!file_.empty()) unlink(file_.c_str());
  close(descriptor_);
}

}  // namespace candela
