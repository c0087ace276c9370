// Chance that a seed decides, the same on every machine.
#pragma once

#include <cstddef>
#include <cstdint>

#include "absl/time/time.h"

namespace candela::testing {

// The step of SplitMix64 (G. Steele, D. Lea, C. Flood, "Fast splittable pseudorandom number generators",
// 2014): the same on every machine, and every bit depends on every other.
constexpr uint64_t kMixStep = 0x9e3779b97f4a7c15u;
constexpr uint64_t mixed(uint64_t word) {
  word += kMixStep;
  word = (word ^ (word >> 30)) * 0xbf58476d1ce4e5b9u;
  word = (word ^ (word >> 27)) * 0x94d049bb133111ebu;
  return word ^ (word >> 31);
}

class Chance {
 public:
  explicit Chance(uint64_t seed) : state_(seed) {}

  uint64_t next() {
    const uint64_t number = mixed(state_);
    state_ += kMixStep;
    return number;
  }
  // 0 .. count - 1.
  size_t below(size_t count) { return next() % count; }
  bool one_in(size_t count) { return below(count) == 0; }
  // `shortest` .. `longest`, and often near the shortest.
  absl::Duration between(absl::Duration shortest, absl::Duration longest) {
    const double part = static_cast<double>(next() >> 11) * 0x1p-53;
    return shortest + (longest - shortest) * (part * part);
  }

 private:
  uint64_t state_;
};

}  // namespace candela::testing
