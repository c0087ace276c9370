#include "server/session/lookahead_memory.h"

namespace candela {

bool LookaheadMemory::change(uint64_t before, uint64_t bytes) {
  const absl::MutexLock lock(&mutex_);
  if (bytes > before && bytes - before > budget_bytes_ - promised_) return false;
  promised_ = promised_ - before + bytes;
  return true;
}

uint64_t LookaheadMemory::promised() const {
  const absl::MutexLock lock(&mutex_);
  return promised_;
}

}  // namespace candela
