// Reservations of texture memory by sessions with look-ahead.
#pragma once

#include <cstdint>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"

namespace candela {

// A frame that waits for later frames keeps its memory until they have theirs. To prevent two sessions from
// waiting for each other's memory, each session reserves memory for its whole look-ahead before its first
// frame gets any. Any thread.
class LookaheadMemory {
 public:
  explicit LookaheadMemory(uint64_t budget_bytes) : budget_bytes_(budget_bytes) {}

  // Changes a session's reservation from `before` to `bytes`. Returns false, and changes nothing, if `bytes`
  // do not fit into the budget beside the other reservations.
  bool change(uint64_t before, uint64_t bytes);

  // The sum of all reservations.
  uint64_t reserved() const;
  uint64_t budget_bytes() const { return budget_bytes_; }

 private:
  const uint64_t budget_bytes_;
  mutable absl::Mutex mutex_;
  uint64_t reserved_ ABSL_GUARDED_BY(mutex_) = 0;
};

}  // namespace candela
