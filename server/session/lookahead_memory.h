// What sessions with look-ahead may hold of the texture memory.
#pragma once

#include <cstdint>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"

namespace candela {

// A frame that waits for later ones keeps its memory until they have theirs. So that no two sessions wait for
// what the other one holds, each is promised all that its look-ahead needs before its first frame has any.
// Any thread.
class LookaheadMemory {
 public:
  explicit LookaheadMemory(uint64_t budget_bytes) : budget_bytes_(budget_bytes) {}

  // A session that was promised `before` bytes is promised `bytes` now. False, and nothing changes, where
  // they do not fit beside the other promises.
  bool change(uint64_t before, uint64_t bytes);
  uint64_t promised() const;

 private:
  const uint64_t budget_bytes_;
  mutable absl::Mutex mutex_;
  uint64_t promised_ ABSL_GUARDED_BY(mutex_) = 0;
};

}  // namespace candela
