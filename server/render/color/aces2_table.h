// The curve `aces-2`: ACES 2.0 for SDR video, 100 nit in Rec.709 (docs/pipeline.md section 5).
#pragma once

#include <array>
#include <memory>

#include "shaders/color_table.h"

namespace candela {

// Exposed scene light (Rec.709, linear, outside of its gamut also negative) to display-linear light (Rec.709,
// 0 .. 1), in double precision. Light outside of ACES AP1 is cut to it. Any thread.
std::array<double, 3> aces_2(const std::array<double, 3>& exposed);

// What resolve computes it from; made once, in 20 ms. Any thread.
std::shared_ptr<const ColorTable> aces_2_table();

}  // namespace candela
