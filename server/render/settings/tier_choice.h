// Which tier keeps a promise: by numbers, not by names.
#pragma once

#include <span>
#include <string>

#include "absl/status/statusor.h"
#include "server/render/settings/settings.h"

namespace candela {

// What a tier costs for one kind of frame on one device.
struct TierNumbers {
  std::string tier;
  double ms = 0.0;               // device time of a frame, median
  double max_error_codes = 0.0;  // that no frame of the kind should exceed
};

struct TierChoice {
  std::string tier;
  std::string reason;  // a line for people
};

// With max_error_codes the fastest tier that keeps it, and max_ms where that is given too; with max_ms alone
// the most accurate one that keeps it. FAILED_PRECONDITION naming the nearest that is possible. `numbers` is
// not empty.
absl::StatusOr<TierChoice> choose_tier(std::span<const TierNumbers> numbers, const v1::Settings& settings);

}  // namespace candela
