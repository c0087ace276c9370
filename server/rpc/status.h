// The one place where the server's errors become gRPC's.
#pragma once

#include <grpcpp/support/status.h>

#include "absl/status/status.h"

namespace candela {

// The code and the message as they are, the message cut to 1 KiB so that it fits into HTTP/2's headers.
// UNAVAILABLE also carries google.rpc.RetryInfo with a delay of one second.
grpc::Status to_grpc(const absl::Status& status);

}  // namespace candela
