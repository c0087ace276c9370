// Bilinear sampling for the references.
#pragma once

#include <cmath>

#include "shaders/reference.h"

namespace candela::reference {

// `level` at (u, v) in texels, with texel (x, y) at exactly (x, y). AnyLevel::at(x, y) must know
// what lies beyond its edge: Level's clamps.
template <typename AnyLevel>
Rgb bilinear(const AnyLevel& level, double u, double v) {
  const double x0 = std::floor(u);
  const double y0 = std::floor(v);
  const double fx = u - x0;
  const double fy = v - y0;
  const auto x = static_cast<int64_t>(x0);
  const auto y = static_cast<int64_t>(y0);
  Rgb out;
  for (int n = 0; n < 3; ++n) {
    out[n] = (1 - fy) * ((1 - fx) * level.at(x, y)[n] + fx * level.at(x + 1, y)[n]) +
             fy * ((1 - fx) * level.at(x, y + 1)[n] + fx * level.at(x + 1, y + 1)[n]);
  }
  return out;
}

}  // namespace candela::reference
