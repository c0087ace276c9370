// The settings of HDR displays and of gain maps. Pure.
#pragma once

#include "absl/status/status.h"
#include "candela/v1/render.pb.h"

namespace candela {

// Checks complete settings. INVALID_ARGUMENT names what does not go together, and what does.
absl::Status check_hdr_display(const v1::Settings& settings);

// The gamut that aces-2 keeps to on an HDR display.
v1::Primaries limit_of(const v1::Settings& settings);

// The peak of the display in nit: with PQ and HLG their own, else reference white.
double display_peak_nits(const v1::Settings& settings);

// The light that the curve makes white: of reinhard-extended a luminance, of bt2390 and shoulder the source's
// peak, in units of reference white.
double curve_white(const v1::Settings& settings);

}  // namespace candela
