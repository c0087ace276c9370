// Checks of the addresses that a server listens on.
#pragma once

#include <string>

#include "absl/status/status.h"

namespace candela {

// OK if `address` is "HOST:PORT" (an IPv6 host is in brackets) or "unix:PATH"; INVALID_ARGUMENT for any other
// shape. Also INVALID_ARGUMENT for a non-loopback host unless `public_too`: without TLS anyone could connect
// and read everything, including tokens.
absl::Status check_listen_address(const std::string& address, bool public_too);

// The same for the metrics address. Metrics are served over plain HTTP on IPv4: no "unix:PATH" and no IPv6.
absl::Status check_metrics_address(const std::string& address, bool insecure);

// UNAVAILABLE if `address` is a "unix:PATH" that another process serves, or a file that is not a socket. This
// check is needed because gRPC unlinks whatever is at the path. OK for every other address, including TCP.
absl::Status check_socket_is_free(const std::string& address);

}  // namespace candela
