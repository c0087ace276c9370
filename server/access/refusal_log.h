// The log of calls that were refused for their token. Only the log tells a missing token from an unknown one:
// the answer to the client is the same, so that it does not help to guess tokens.
#pragma once

#include <array>
#include <cstdint>
#include <string>

#include "absl/base/thread_annotations.h"
#include "absl/functional/function_ref.h"
#include "absl/synchronization/mutex.h"
#include "server/base/clock.h"
#include "server/base/net/rate_limit.h"

namespace candela {

enum class Refusal { kNoToken, kUnknownToken };

// Writes at most one line a second for each reason, however many calls a stranger makes. It names the client
// of the last of them. Any thread.
class RefusalLog {
 public:
  // `clock` outlives it.
  explicit RefusalLog(Clock& clock) : clock_(clock) {}

  // `peer` is called only if there is a line.
  void add(Refusal refusal, absl::FunctionRef<std::string()> peer);

 private:
  Clock& clock_;
  absl::Mutex mutex_;
  std::array<OneASecond, 2> reasons_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace candela
