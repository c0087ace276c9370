// retry() with the caller's clock, which tests move.
#pragma once

#include <cstddef>

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "absl/time/time.h"
#include "client/retry.h"
#include "server/base/clock.h"

namespace candela {

// `wait` waits for that long; if it returns false, the result is CANCELLED. options.stop is not looked at.
absl::Status retry_by(Clock& clock, absl::FunctionRef<bool(absl::Duration)> wait, size_t servers,
                      const RetryOptions& options, absl::FunctionRef<absl::Status(size_t server)> attempt);

}  // namespace candela
