#include "server/listen_address.h"

#include <optional>

#include "absl/strings/str_format.h"
#include "server/base/net/address.h"

namespace candela {

absl::Status check_listen_address(const std::string& address, bool public_too) {
  if (is_unix_address(address)) return absl::OkStatus();
  const std::optional<HostPort> at = parse_host_port(address);
  if (!at) {
    return absl::InvalidArgumentError(
        absl::StrFormat("listen address '%s' is neither HOST:PORT (port 0 .. 65535) nor unix:PATH", address));
  }
  if (public_too || is_loopback(at->host)) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrFormat(
      "'%s' is reachable from other machines, but TLS is off; set --tls-cert and --tls-key, listen on "
      "127.0.0.1 behind a proxy, or allow anyone there to connect and read everything, including tokens, "
      "with --insecure",
      address));
}

absl::Status check_metrics_address(const std::string& address, bool insecure) {
  const std::optional<HostPort> at = parse_host_port(address);
  if (!at) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "metrics is '%s'; it must be HOST:PORT (port 0 .. 65535), because metrics are served over HTTP",
        address));
  }
  if (insecure || is_loopback(at->host)) return absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrFormat("metrics is '%s', which is reachable from other machines, and metrics have no TLS; "
                      "serve them on 127.0.0.1, or allow anyone there to read them with --insecure",
                      address));
}

}  // namespace candela
