// Everything that is known about a rendered frame, except its image, which is in its FrameMemory.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "server/render/plan/plan.h"
#include "server/render/plan/stage_time.h"
#include "server/render/reference/verification.h"

namespace candela {

struct FrameReport {
  FrameStats stats;
  double exposure = 0.0;  // the factor E that was used
  double target = 0.0;    // the factor that metering chose
  double target_before_limits = 0.0;
  uint64_t gamut_cut_components = 0;  // of R, G and B: negative in the curve's own primaries, and cut
  Plan plan;
  std::string tier;                   // that the frame was drawn with
  std::string tier_reason;            // if max_error_codes chose it, a line for people
  std::optional<double> error_bound;  // if max_error_codes chose the tier: the largest error in codes
  std::vector<StageTime> stages;
  std::optional<FrameVerification> verification;  // if the memory was taken for it
};

}  // namespace candela
