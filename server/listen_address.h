// Where a server may listen.
#pragma once

#include <string>

#include "absl/status/status.h"

namespace candela {

// `address` is "HOST:PORT", with an IPv6 host in brackets, or "unix:PATH". INVALID_ARGUMENT for any other
// shape, and, unless `public_too`, for a host beyond loopback, where without TLS anyone could connect and
// read, tokens among all else.
absl::Status check_listen_address(const std::string& address, bool public_too);

// The same for metrics, which are served over HTTP alone: no "unix:PATH", and no IPv6.
absl::Status check_metrics_address(const std::string& address, bool insecure);

// UNAVAILABLE where a "unix:PATH" is served by somebody else already, or is a file that is no socket: gRPC
// unlinks whatever lies there. OK for all others, TCP among them.
absl::Status check_socket_is_free(const std::string& address);

}  // namespace candela
