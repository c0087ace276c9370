// The gain curve of settings. Internal to server/render.
#pragma once

#include <memory>

#include "candela/v1/render.pb.h"
#include "server/render/color/hdr_signal.h"
#include "shaders/color_table.h"

namespace candela {

// The gain curve that the settings' tone curve and gain_map_peak_nits ask for; null without the latter.
// `settings` are complete; `table` is that of the curve TABLE. Takes 5 to 20 ms. Any thread.
std::shared_ptr<const GainCurve> gain_curve_of(const v1::Settings& settings,
                                               const std::shared_ptr<const ColorTable>& table);

}  // namespace candela
