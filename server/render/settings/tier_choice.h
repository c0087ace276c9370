// The choice of a tier that keeps a promise.
#pragma once

#include <span>
#include <string>

#include "absl/status/statusor.h"
#include "server/render/settings/error_bound.h"
#include "server/render/settings/settings.h"

namespace candela {

// A tier's time for one kind of frame on one device.
struct TierNumbers {
  std::string tier;
  double ms = 0.0;  // median device time of a frame
};

struct TierChoice {
  std::string tier;
  std::string reason;  // a line for people
};

// The part of the choice that max_ms has. With max_ms alone, chooses the most accurate tier within the time.
// With max_error_codes, too, chooses the most accurate tier whose bound may be within that limit.
// FAILED_PRECONDITION names the closest tier if none is within the time, or none of those that are can keep
// max_error_codes for any frame. `numbers` has every tier, in the order of tiers().
absl::StatusOr<TierChoice> choose_by_time(std::span<const TierNumbers> numbers, const Settings& settings);

// Why max_error_codes chose this tier, whose bound for the frame is `bound`.
std::string reason_for(const Tier& tier, double bound, const Settings& settings, const BoundFacts& facts);

// FAILED_PRECONDITION: no tier within max_ms keeps max_error_codes for a frame with these facts.
absl::Status no_tier_keeps(const Settings& settings, const BoundFacts& facts);

}  // namespace candela
