// Linear interpolation between samples in a row.
#pragma once

#include <algorithm>
#include <cstdint>

namespace candela {

// Two neighbours, and the second's share.
struct Neighbours {
  uint32_t first, second;
  double share;
};

// Those of a place among `count` samples, of which sample i lies at i. Outside is the nearest sample.
inline Neighbours neighbours_of(double place, uint32_t count) {
  const double inside = std::clamp(place, 0.0, count - 1.0);
  const auto first = static_cast<uint32_t>(inside);
  return {first, std::min(first + 1, count - 1), inside - first};
}

}  // namespace candela
