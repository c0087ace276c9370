#include "server/render/exposure.h"

#include <algorithm>
#include <cmath>

namespace candela {

double exposure_target(const ExposureSettings& settings, double mean_log2_luminance) {
  if (settings.mode == ExposureMode::kManual) return std::exp2(settings.manual_ev);
  const double wanted = settings.key * std::exp2(settings.compensation_ev - mean_log2_luminance);
  return std::clamp(wanted, settings.min_exposure, settings.max_exposure);
}

}  // namespace candela
