// The choice of a tier that keeps a promise, by measured time and error.
#pragma once

#include <span>
#include <string>

#include "absl/status/statusor.h"
#include "server/render/settings/settings.h"

namespace candela {

// A tier's time and error for one kind of frame on one device.
struct TierNumbers {
  std::string tier;
  double ms = 0.0;               // device time of a frame, median
  double max_error_codes = 0.0;  // the largest error expected in any such frame
};

struct TierChoice {
  std::string tier;
  std::string reason;  // a line for people
};

// With max_error_codes, chooses the fastest tier that keeps it, and that also keeps max_ms if that is given.
// With max_ms alone, chooses the most accurate tier that keeps it. If no tier does, FAILED_PRECONDITION names
// the closest one. `numbers` is not empty.
absl::StatusOr<TierChoice> choose_tier(std::span<const TierNumbers> numbers, const v1::Settings& settings);

}  // namespace candela
