#include "server/render/frame_maker.h"

#include <cmath>

#include "server/base/check.h"
#include "server/base/status_macros.h"

namespace candela {

FrameReport report_of(const Metered& metered, const Exposed& exposed) {
  CHECK(std::isfinite(exposed.exposure) && exposed.exposure > 0);
  FrameReport report;
  report.stats = metered.stats;
  report.exposure = exposed.exposure;
  report.target = exposed.target;
  report.target_before_limits = exposed.target_before_limits;
  report.stages = metered.stages;
  return report;
}

absl::StatusOr<FrameReport> FrameMaker::render(FrameMemory& memory, const Settings& settings,
                                               const FrameMoment& moment) {
  ASSIGN_OR_RETURN(const Metered metered, meter(memory, settings));
  const Exposed exposed = expose(settings->exposure(), moment.previous, metered.stats.metered_mean());
  return draw(memory, settings, moment.sequence, metered, exposed);
}

}  // namespace candela
