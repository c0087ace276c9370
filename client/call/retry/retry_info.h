// The wait that a busy server asks of a client before its next call.
#pragma once

#include <grpcpp/support/status.h>

#include <optional>

#include "absl/status/status.h"
#include "absl/time/time.h"

namespace candela {

// The delay in the status's google.rpc.RetryInfo, or zero if it has none that can be read.
absl::Duration retry_delay(const grpc::Status& status);

// Notes in a user's status that a server was reached and may do the work after `delay`; see retry_after().
void set_retry_delay(absl::Status& status, absl::Duration delay);
std::optional<absl::Duration> noted_retry_delay(const absl::Status& status);

}  // namespace candela
