// Checks of the addresses that a server listens on.
#pragma once

#include <string>

#include "absl/status/status.h"

namespace candela {

// OK if `address` is "HOST:PORT" (an IPv6 host is in brackets) or "unix:PATH"; INVALID_ARGUMENT for any other
// shape. Also INVALID_ARGUMENT for a non-loopback host unless `public_too`: without TLS anyone could connect
// and read everything, including tokens.
absl::Status check_listen_address(const std::string& address, bool public_too);

// The same for the metrics address. Metrics are served over plain HTTP, and not on "unix:PATH".
absl::Status check_metrics_address(const std::string& address, bool insecure);

}  // namespace candela
