// The run of a sequence of files through a session: images, or metering alone.
#pragma once

#include "absl/status/statusor.h"
#include "client/run/events.h"
#include "client/run/exposure/shot_exposures.h"
#include "client/run/options.h"
#include "client/run/report.h"
#include "client/run/stream_plan.h"

namespace candela {

// Renders the frames of the plan and writes its images. Frames from standard input join plan.sequence.
absl::StatusOr<RunSummary> render_sequence(const StreamOptions& options, const ShotExposures& shot,
                                           StreamPlan& plan, RunEvents& events);

}  // namespace candela
