#include "server/session/lookahead_memory.h"

namespace candela {

bool LookaheadMemory::change(uint64_t before, uint64_t bytes) {
  const absl::MutexLock lock(&mutex_);
  if (bytes > before && bytes - before > budget_bytes_ - reserved_) return false;
  reserved_ = reserved_ - before + bytes;
  return true;
}

uint64_t LookaheadMemory::reserved() const {
  const absl::MutexLock lock(&mutex_);
  return reserved_;
}

}  // namespace candela
