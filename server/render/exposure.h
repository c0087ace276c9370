// Exposure: a pure function on the host, in double (docs/pipeline.md section 3).
#pragma once

#include "server/render/settings.h"

namespace candela {

// The factor that a frame of this mean log2 luminance asks for: key / 2^mean * 2^compensation within the
// limits, or 2^manual_ev. Finite and above 0 for settings that pass check_settings.
double exposure_target(const ExposureSettings& settings, double mean_log2_luminance);

}  // namespace candela
