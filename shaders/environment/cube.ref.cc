// Twin of the lookups in cube maps, which cube_specular.comp and view.comp share.
#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "shaders/environment/environment.h"

namespace candela::reference {

namespace {

// Texel (i, j) of a face, which may lie beyond one of its edges. There the plane of the face is folded down
// over the edge, and the point lies on the neighbour.
const Rgb& folded(const CubeLevel& level, uint32_t face, int64_t i, int64_t j) {
  const double size = level.size;
  const auto place = [size](int64_t index) { return (2.0 * static_cast<double>(index) + 1.0) / size - 1.0; };
  Direction p = cube_point({face, place(i), place(j)});
  for (size_t axis = 0; axis < 3; ++axis) {
    const double beyond = std::abs(p[axis]) - 1.0;
    if (beyond <= 0.0) continue;
    p[axis] = std::copysign(1.0, p[axis]);
    p[face / 2] *= 1.0 - beyond;
  }
  const CubeSpot spot = cube_spot(p);
  const auto index = [size](double st) { return static_cast<uint32_t>(std::floor((st + 1.0) / 2.0 * size)); };
  return level.at(spot.face, index(spot.s), index(spot.t));
}

// One face with the texels around it.
struct Face {
  const CubeLevel& level;
  uint32_t face;

  Rgb at(int64_t i, int64_t j) const {
    const int64_t inside_i = std::clamp<int64_t>(i, 0, level.size - 1);
    const int64_t inside_j = std::clamp<int64_t>(j, 0, level.size - 1);
    if (i == inside_i || j == inside_j) return folded(level, face, i, j);
    // Beyond a corner: the mean of the three texels that meet there.
    Rgb mean{};
    accumulate(&mean, level.at(face, static_cast<uint32_t>(inside_i), static_cast<uint32_t>(inside_j)),
               1.0 / 3.0);
    accumulate(&mean, folded(level, face, i, inside_j), 1.0 / 3.0);
    accumulate(&mean, folded(level, face, inside_i, j), 1.0 / 3.0);
    return mean;
  }
};

}  // namespace

Direction cube_point(const CubeSpot& spot) {
  const double s = spot.s;
  const double t = spot.t;
  switch (spot.face) {
    case 0:
      return {1.0, -t, -s};
    case 1:
      return {-1.0, -t, s};
    case 2:
      return {s, 1.0, t};
    case 3:
      return {s, -1.0, -t};
    case 4:
      return {s, -t, 1.0};
    default:
      return {-s, -t, -1.0};
  }
}

CubeSpot cube_spot(const Direction& d) {
  size_t axis = 0;
  for (size_t other = 1; other < 3; ++other) {
    if (std::abs(d[other]) > std::abs(d[axis])) axis = other;
  }
  const double m = std::abs(d[axis]);
  const double x = d[0] / m;
  const double y = d[1] / m;
  const double z = d[2] / m;
  const bool negative = d[axis] < 0.0;
  if (axis == 0) return negative ? CubeSpot{1, z, -y} : CubeSpot{0, -z, -y};
  if (axis == 1) return negative ? CubeSpot{3, x, -z} : CubeSpot{2, x, z};
  return negative ? CubeSpot{5, -x, -y} : CubeSpot{4, x, -y};
}

Rgb cube_at(const CubeLevel& level, const Direction& d) {
  const CubeSpot spot = cube_spot(d);
  const double i = (spot.s + 1.0) / 2.0 * level.size - 0.5;
  const double j = (spot.t + 1.0) / 2.0 * level.size - 0.5;
  return bilinear(Face{level, spot.face}, i, j);
}

Rgb cube_at(std::span<const CubeLevel> chain, const Direction& d, double lod) {
  const double last = static_cast<double>(chain.size()) - 1.0;
  const double at = std::clamp(lod, 0.0, last);
  const double fine = std::floor(at);
  const double coarse = std::min(fine + 1.0, last);
  Rgb out{};
  accumulate(&out, cube_at(chain[static_cast<size_t>(fine)], d), 1.0 - (at - fine));
  accumulate(&out, cube_at(chain[static_cast<size_t>(coarse)], d), at - fine);
  return out;
}

}  // namespace candela::reference
