// When a server that is busy wants to be asked again.
#pragma once

#include <grpcpp/support/status.h>

#include "absl/time/time.h"

namespace candela {

// The delay of the status's google.rpc.RetryInfo; zero where there is none, or none that can be read.
absl::Duration retry_delay(const grpc::Status& status);

}  // namespace candela
