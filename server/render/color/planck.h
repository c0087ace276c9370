// The colour of a black body.
#pragma once

#include <array>

namespace candela {

// CIE 1931 XYZ of the light of a black body at this temperature, above 0 K, up to a factor. It is Planck's
// law itself, summed over the colour-matching functions of the 2-degree observer at steps of 5 nm, so it is
// as smooth as the law.
std::array<double, 3> planckian_xyz(double kelvin);

}  // namespace candela
