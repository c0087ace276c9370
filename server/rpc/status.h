// Conversion of errors into gRPC statuses, in one place.
#pragma once

#include <grpcpp/support/status.h>

#include "absl/status/status.h"

namespace candela {

// Keeps the code and the message, and truncates the message to 1 KiB so that it fits into the HTTP/2 headers.
// UNAVAILABLE also carries a google.rpc.RetryInfo with a delay of one second.
grpc::Status to_grpc(const absl::Status& status);

}  // namespace candela
