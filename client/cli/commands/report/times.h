// The times of a report: how long frames take by size and tier, and how scenes and settings change that.
// docs/report/format.md describes the rows.
#pragma once

#include <vector>

#include "absl/time/time.h"
#include "client/cli/commands/report/scenes.h"
#include "client/cli/commands/report/session.h"

namespace candela {

struct TimePlan {
  std::vector<FrameSize> sizes;                  // ascending
  int frames = 11;                               // number of timed frames, after a warm-up of two
  int slow_frames = 3;                           // the same for frames that take seconds; no warm-up
  absl::Time deadline = absl::InfiniteFuture();  // work that would pass it is skipped, and its row says so
};

// `times`: every size at every tier.
Json measure_times(const ReportSession& session, const TimePlan& plan);

// `scenes`: scenes and settings at the largest planned size of at most 2 megapixels.
Json measure_scenes(const ReportSession& session, const TimePlan& plan);

}  // namespace candela
