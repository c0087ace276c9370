// The wait that a busy server asks of a client before its next call.
#pragma once

#include <grpcpp/support/status.h>

#include "absl/time/time.h"

namespace candela {

// The delay in the status's google.rpc.RetryInfo, or zero if it has none that can be read.
absl::Duration retry_delay(const grpc::Status& status);

}  // namespace candela
