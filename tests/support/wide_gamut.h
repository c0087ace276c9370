// Saturated colours of wide-gamut primaries, for the tests of light outside of Rec.709.
#pragma once

#include <array>
#include <cstddef>
#include <vector>

#include "candela/v1/render.pb.h"

namespace candela::testing {

using Color = std::array<float, 3>;

// Linear light of the same colours in two sets of primaries.
struct Saturated {
  std::vector<Color> own;     // in the primaries that were asked for
  std::vector<Color> rec709;  // with negative components
};

// `count` colours of these primaries from 2^-12 to 2^8: ramps of the pure primaries and their sums, mixtures
// of two primaries, and colours with one component far below the others. All lie inside of ACES AP1. The same
// on every machine.
Saturated saturated_inside_ap1(v1::Primaries primaries, size_t count);

// The error of a display value, in codes, for display-linear light that should be shown by the sRGB curve.
double codes_off(double value, double light);

}  // namespace candela::testing
