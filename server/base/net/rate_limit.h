// Limits events that a stranger can cause without end, such as log lines, to one a second.
#pragma once

#include <cstdint>
#include <optional>
#include <utility>

#include "absl/time/time.h"

namespace candela {

// Not thread-safe.
class OneASecond {
 public:
  // Counts an event. If it may pass, returns the number of events since the last one that passed, this one
  // included; otherwise nothing.
  std::optional<uint64_t> pass(absl::Time now) {
    ++events_;
    if (now < next_) return std::nullopt;
    next_ = now + absl::Seconds(1);
    return std::exchange(events_, 0);
  }

 private:
  uint64_t events_ = 0;
  absl::Time next_ = absl::InfinitePast();
};

}  // namespace candela
