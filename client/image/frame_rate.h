// How many frames of a sequence are shown in how many seconds: an exact fraction, because film rates such as
// 24000/1001 are no decimal numbers.
#pragma once

#include <cstdint>

namespace candela {

struct FrameRate {
  uint64_t frames = 24;  // at least 1
  uint64_t seconds = 1;  // at least 1

  bool operator==(const FrameRate& other) const = default;
};

}  // namespace candela
