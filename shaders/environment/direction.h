// Arithmetic of directions and colours for the references of environments.
#pragma once

#include <cmath>
#include <numbers>

#include "shaders/environment/environment.h"

namespace candela::reference {

constexpr double kPi = std::numbers::pi;

inline double dot(const Direction& a, const Direction& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

inline Direction cross(const Direction& a, const Direction& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

// a + factor * b.
inline Direction add(const Direction& a, const Direction& b, double factor) {
  return {a[0] + factor * b[0], a[1] + factor * b[1], a[2] + factor * b[2]};
}

inline Direction normalized(const Direction& d) {
  const double length = std::sqrt(dot(d, d));
  return {d[0] / length, d[1] / length, d[2] / length};
}

// *sum += weight * color, of R, G and B. `color` may have an alpha.
template <typename Color>
void accumulate(Rgb* sum, const Color& color, double weight) {
  for (size_t n = 0; n < 3; ++n) (*sum)[n] += weight * color[n];
}

}  // namespace candela::reference
