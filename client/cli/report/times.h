// The time half of a report: how long frames take, and what of it is what a scene needs.
#pragma once

#include <vector>

#include "absl/time/time.h"
#include "client/cli/report/scenes.h"
#include "client/cli/report/session.h"

namespace candela {

struct TimePlan {
  std::vector<FrameSize> sizes;                  // ascending
  int frames = 11;                               // timed, after a warm-up of two
  int slow_frames = 3;                           // of those that take seconds, timed without a warm-up
  absl::Time deadline = absl::InfiniteFuture();  // what would pass it is left out, and the rows say so
};

// A row a size and tier: megapixels, width, height, tier and either skipped (why) or frames, device_ms,
// call_ms and memcpy_ms {p10, median, p90}, memcpy_ratio, stages [{name, ms {p10, median, p90}}] and either
// error {max_codes, p999_codes, mean_codes} or error_skipped (why).
Json measure_times(const ReportSession& session, const TimePlan& plan);

// What scenes and settings cost, at the largest planned size of at most 2 megapixels: a row each, with what,
// width, height, plan, device_ms, memcpy_ms, memcpy_ratio and stages as above, or what and error (why not).
Json measure_scenes(const ReportSession& session, const TimePlan& plan);

}  // namespace candela
