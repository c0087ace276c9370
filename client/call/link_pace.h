// Which frames of a call are compressed: those on a link that is slower than compressing them.
#pragma once

#include <cstdint>

#include "absl/time/time.h"

namespace candela {

// Looks at how fast the link takes frames that are not compressed. Used by one thread at a time.
class LinkPace {
 public:
  // A frame begins. Returns whether to compress it.
  bool next_frame();
  // The frame's band `index` of `bytes` bytes, not compressed, took `time` until the next one could be
  // written.
  void wrote(uint64_t index, uint64_t bytes, absl::Duration time);

 private:
  bool slow_ = false;
  uint64_t compressed_ = 0;  // frames since the last one that was not
  // Sums over the measured bands of the last frame, and the largest of them.
  uint64_t bytes_ = 0, largest_ = 0;
  absl::Duration time_ = absl::ZeroDuration(), longest_ = absl::ZeroDuration();
};

}  // namespace candela
