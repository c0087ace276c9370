#include "server/listen_address.h"

#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <optional>

#include "absl/strings/match.h"
#include "absl/strings/str_format.h"
#include "absl/strings/string_view.h"
#include "absl/strings/strip.h"
#include "proto/candela/v1/address.h"

namespace candela {

absl::Status check_listen_address(const std::string& address, bool public_too) {
  if (v1::is_unix_address(address)) return absl::OkStatus();
  const std::optional<v1::HostPort> at = v1::parse_host_port(address);
  if (!at) {
    return absl::InvalidArgumentError(
        absl::StrFormat("listen address '%s' is neither HOST:PORT (port 0 .. 65535) nor unix:PATH", address));
  }
  if (public_too || v1::is_loopback(at->host)) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrFormat(
      "'%s' is reachable from other machines, but TLS is off; set --tls-cert and --tls-key, listen on "
      "127.0.0.1 behind a proxy, or allow anyone there to connect and read everything, including tokens, "
      "with --insecure",
      address));
}

absl::Status check_metrics_address(const std::string& address, bool insecure) {
  const std::optional<v1::HostPort> at = v1::parse_host_port(address);
  if (!at) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "metrics is '%s'; it must be HOST:PORT (port 0 .. 65535), because metrics are served over HTTP",
        address));
  }
  if (absl::StrContains(at->host, ':')) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "metrics is '%s'; it must be an IPv4 address, because Debian's civetweb is built without IPv6; write "
        "127.0.0.1:PORT",
        address));
  }
  if (insecure || v1::is_loopback(at->host)) return absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrFormat("metrics is '%s', which is reachable from other machines, and metrics have no TLS; "
                      "serve them on 127.0.0.1, or allow anyone there to read them with --insecure",
                      address));
}

absl::Status check_socket_is_free(const std::string& address) {
  absl::string_view path = address;
  if (!absl::ConsumePrefix(&path, "unix:")) return absl::OkStatus();
  if (absl::StartsWith(path, "//")) path.remove_prefix(2);
  sockaddr_un to{};
  if (path.size() >= sizeof to.sun_path) return absl::OkStatus();  // gRPC refuses a path that is too long
  to.sun_family = AF_UNIX;
  std::memcpy(to.sun_path, path.data(), path.size());

  struct stat info;
  if (lstat(to.sun_path, &info) != 0) return absl::OkStatus();
  if (!S_ISSOCK(info.st_mode)) {
    return absl::UnavailableError(
        absl::StrFormat("cannot listen on %s: a file with that name exists and is not a socket; remove it or "
                        "pass another --listen",
                        address));
  }
  const int probe = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  const bool served =
      probe >= 0 && (connect(probe, reinterpret_cast<sockaddr*>(&to), sizeof to) == 0 || errno == EAGAIN);
  if (probe >= 0) close(probe);
  if (!served) return absl::OkStatus();  // left over from a process that has ended
  return absl::UnavailableError(absl::StrFormat(
      "cannot listen on %s: it is in use; stop the program that listens there or pass another --listen",
      address));
}

}  // namespace candela
