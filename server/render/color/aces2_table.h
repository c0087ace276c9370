// The curve `aces-2`: ACES 2.0 for SDR video of 100 nit in Rec.709, and for HDR displays (docs/pipeline.md
// section 5).
#pragma once

#include <algorithm>
#include <array>
#include <memory>

#include "candela/v1/render.pb.h"
#include "shaders/color_table.h"

namespace candela {

// What it is made for.
struct Aces2Display {
  double peak_nits = 100.0;
  v1::Primaries limit = v1::PRIMARIES_REC709;  // its light is within their gamut, and in them
};

// The peaks of HDR displays for which the Academy has published it, in nit.
inline constexpr double kAces2HdrPeaks[] = {500, 1000, 2000, 4000};
constexpr bool aces_2_has_peak(double peak_nits) { return std::ranges::count(kAces2HdrPeaks, peak_nits) > 0; }

// Exposed scene light (Rec.709, linear, outside of its gamut also negative) to display-linear light, 0 .. 1
// at the peak, in double precision. Light outside of ACES AP1 is cut to it. An HDR display has the limit
// P3_D65 or REC2020, and aces_2_has_peak(). Any thread.
std::array<double, 3> aces_2(const std::array<double, 3>& exposed, const Aces2Display& display = {});

// What resolve computes it from; made once for each display, in 20 ms. Any thread.
std::shared_ptr<const ColorTable> aces_2_table(const Aces2Display& display = {});

}  // namespace candela
