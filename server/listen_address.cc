#include "server/listen_address.h"

#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <cerrno>
#include <cstdint>
#include <cstring>
#include <optional>

#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_format.h"
#include "absl/strings/string_view.h"
#include "absl/strings/strip.h"

namespace candela {
namespace {

constexpr uint32_t kMaxPort = 65535;

bool is_loopback(absl::string_view host) {
  const bool all_digits = host.find_first_not_of("0123456789.") == absl::string_view::npos;
  return host == "localhost" || host == "::1" || (all_digits && absl::StartsWith(host, "127."));
}

// Of "HOST:PORT", without the brackets of an IPv6 host; nothing for any other shape.
std::optional<absl::string_view> host_of(absl::string_view address) {
  const size_t colon = address.rfind(':');
  if (colon == absl::string_view::npos || colon == 0) return std::nullopt;
  absl::string_view host = address.substr(0, colon);
  uint32_t port = 0;
  if (!absl::SimpleAtoi(address.substr(colon + 1), &port) || port > kMaxPort) return std::nullopt;
  const bool bracketed = absl::ConsumePrefix(&host, "[") && absl::ConsumeSuffix(&host, "]");
  if (host.empty() || (!bracketed && host.find_first_of("[]:/") != absl::string_view::npos)) {
    return std::nullopt;
  }
  return host;
}

}  // namespace

absl::Status check_listen_address(const std::string& address, bool public_too) {
  if (absl::StartsWith(address, "unix:") && address.size() > 5) return absl::OkStatus();
  const std::optional<absl::string_view> host = host_of(address);
  if (!host) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "listen address '%s' is neither HOST:PORT (port 0 .. %d) nor unix:PATH", address, kMaxPort));
  }
  if (public_too || is_loopback(*host)) return absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrFormat("'%s' is reachable from other machines and this server has no TLS; give it --tls-cert "
                      "and --tls-key, listen on 127.0.0.1 behind a proxy, or accept that anyone there can "
                      "connect and read, tokens too, with --insecure",
                      address));
}

absl::Status check_metrics_address(const std::string& address, bool insecure) {
  const std::optional<absl::string_view> host = host_of(address);
  if (!host) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "metrics is '%s'; it must be HOST:PORT (port 0 .. %d), for metrics are served over HTTP", address,
        kMaxPort));
  }
  if (absl::StrContains(*host, ':')) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "metrics is '%s'; they are served over IPv4 alone, for Debian's civetweb is built without "
        "IPv6: write 127.0.0.1:PORT",
        address));
  }
  if (insecure || is_loopback(*host)) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrFormat(
      "metrics is '%s', which is reachable from other machines, and metrics have no TLS; serve them "
      "on 127.0.0.1, or accept that anyone there can read them with --insecure",
      address));
}

absl::Status check_socket_is_free(const std::string& address) {
  absl::string_view path = address;
  if (!absl::ConsumePrefix(&path, "unix:")) return absl::OkStatus();
  if (absl::StartsWith(path, "//")) path.remove_prefix(2);
  sockaddr_un to{};
  if (path.size() >= sizeof to.sun_path) return absl::OkStatus();  // gRPC refuses it by its length
  to.sun_family = AF_UNIX;
  std::memcpy(to.sun_path, path.data(), path.size());

  struct stat info;
  if (lstat(to.sun_path, &info) != 0) return absl::OkStatus();
  if (!S_ISSOCK(info.st_mode)) {
    return absl::UnavailableError(
        absl::StrFormat("cannot listen on %s: there is a file of that name that is no socket; remove it or "
                        "pass another --listen",
                        address));
  }
  const int probe = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  const bool served =
      probe >= 0 && (connect(probe, reinterpret_cast<sockaddr*>(&to), sizeof to) == 0 || errno == EAGAIN);
  if (probe >= 0) close(probe);
  if (!served) return absl::OkStatus();  // left behind by a process that is gone
  return absl::UnavailableError(absl::StrFormat(
      "cannot listen on %s: it is in use; stop what listens there or pass another --listen", address));
}

}  // namespace candela
