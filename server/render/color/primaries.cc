#include "server/render/color/primaries.h"

#include <ImathMatrix.h>
#include <ImathVec.h>

#include <cmath>

#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "server/render/color/planck.h"

namespace candela {

namespace {

using Imath::M33d;
using Imath::V3d;

// Imath multiplies row vectors from the left: v * (A * B) applies A first.

V3d xyz(double x, double y) { return {x / y, 1.0, (1.0 - x - y) / y}; }

M33d rows(const V3d& a, const V3d& b, const V3d& c) { return {a.x, a.y, a.z, b.x, b.y, b.z, c.x, c.y, c.z}; }

// Real primaries stay below 100; beyond this, three products with +-65504 could leave a float's range.
constexpr double kMaxEntry = 1e6;

bool usable(const M33d& m) {
  const double d = m.determinant();
  return std::isfinite(d) && std::abs(d) > 1e-9;
}

// Linear RGB to XYZ, white at Y = 1; a singular result means singular primaries.
M33d to_xyz(const std::array<double, 8>& c) {
  const M33d primaries =
      rows({c[0], c[1], 1 - c[0] - c[1]}, {c[2], c[3], 1 - c[2] - c[3]}, {c[4], c[5], 1 - c[4] - c[5]});
  if (!usable(primaries) || !(std::abs(c[7]) > 1e-9)) return M33d(0.0);
  const V3d scale = xyz(c[6], c[7]) * primaries.inverse();
  return rows({scale.x, 0, 0}, {0, scale.y, 0}, {0, 0, scale.z}) * primaries;
}

M33d bradford(const V3d& from_white, const V3d& to_white) {
  const M33d cone =
      M33d(0.8951, 0.2664, -0.1614, -0.7502, 1.7135, 0.0367, 0.0389, -0.0685, 1.0296).transposed();
  const V3d from = from_white * cone;
  const V3d to = to_white * cone;
  return cone * rows({to.x / from.x, 0, 0}, {0, to.y / from.y, 0}, {0, 0, to.z / from.z}) * cone.inverse();
}

// CIE 1960 UCS.
struct Uv {
  double u;
  double v;
};

// The Planckian locus at a temperature.
Uv locus(double kelvin) {
  const auto [x, y, z] = planckian_xyz(kelvin);
  const double scale = x + 15 * y + 3 * z;
  return {4 * x / scale, 6 * y / scale};
}

bool close(const Chromaticities& a, const Chromaticities& b, size_t first, double tolerance) {
  for (size_t i = first; i < a.xy.size(); ++i) {
    if (!(std::abs(a.xy[i] - b.xy[i]) <= tolerance)) return false;
  }
  return true;
}

absl::Status unusable(const Chromaticities& chromaticities) {
  return absl::InvalidArgumentError(absl::StrFormat(
      "input_chromaticities (%s) are not three independent primaries and a white; leave them out for Rec.709",
      absl::StrJoin(chromaticities.xy, " ")));
}

}  // namespace

Chromaticities chromaticities(v1::Primaries primaries) {
  constexpr double kD65[2] = {0.3127, 0.3290};
  constexpr double kAcesWhite[2] = {0.32168, 0.33767};
  switch (primaries) {
    case v1::PRIMARIES_REC709:
      return {{0.64, 0.33, 0.30, 0.60, 0.15, 0.06, kD65[0], kD65[1]}};
    case v1::PRIMARIES_REC2020:
      return {{0.708, 0.292, 0.170, 0.797, 0.131, 0.046, kD65[0], kD65[1]}};
    case v1::PRIMARIES_P3_D65:
      return {{0.680, 0.320, 0.265, 0.690, 0.150, 0.060, kD65[0], kD65[1]}};
    case v1::PRIMARIES_ACES_AP0:
      return {{0.7347, 0.2653, 0.0, 1.0, 0.0001, -0.0770, kAcesWhite[0], kAcesWhite[1]}};
    case v1::PRIMARIES_ACES_AP1:
      return {{0.713, 0.293, 0.165, 0.830, 0.128, 0.044, kAcesWhite[0], kAcesWhite[1]}};
    case v1::PRIMARIES_XYZ:
      return {{1, 0, 0, 1, 0, 0, 1.0 / 3, 1.0 / 3}};
    default:
      return {};
  }
}

Chromaticities chromaticities(const v1::Chromaticities& m) {
  return {{m.red_x(), m.red_y(), m.green_x(), m.green_y(), m.blue_x(), m.blue_y(), m.white_x(), m.white_y()}};
}

std::array<double, 9> matrix_to_xyz(const Chromaticities& from) {
  const M33d m = to_xyz(from.xy).transposed();
  return {m[0][0], m[0][1], m[0][2], m[1][0], m[1][1], m[1][2], m[2][0], m[2][1], m[2][2]};
}

White white_of(double kelvin, double tint) {
  constexpr double kTintUv = 0.05;
  constexpr double kStepKelvin = 1.0;  // for the direction of the locus
  const Uv at = locus(kelvin);
  const Uv cooler = locus(kelvin + kStepKelvin);
  const Uv warmer = locus(kelvin - kStepKelvin);
  // The locus runs towards smaller u as the temperature rises, so this normal points upwards.
  const double along_u = warmer.u - cooler.u;
  const double along_v = warmer.v - cooler.v;
  const double distance = kTintUv * tint / std::hypot(along_u, along_v);
  const Uv moved = {at.u - along_v * distance, at.v + along_u * distance};
  const double scale = 2 * moved.u - 8 * moved.v + 4;
  return {3 * moved.u / scale, 2 * moved.v / scale};
}

absl::StatusOr<std::optional<std::array<float, 9>>> matrix_to_rec709(
    const Chromaticities& from, const std::optional<White>& scene_white) {
  const auto& c = from.xy;
  const auto rec709 = chromaticities(v1::PRIMARIES_REC709);
  const bool plain_xyz = close(from, chromaticities(v1::PRIMARIES_XYZ), 0, 1e-4);
  M33d m = plain_xyz ? M33d() : to_xyz(c);
  if (!usable(m)) return unusable(from);
  if (!plain_xyz && !close(from, rec709, 6, 1e-5)) {
    m = m * bradford(xyz(c[6], c[7]), xyz(rec709.xy[6], rec709.xy[7]));
  }
  if (scene_white) {
    m = m * bradford(xyz(scene_white->x, scene_white->y), xyz(rec709.xy[6], rec709.xy[7]));
  }
  m = m * to_xyz(rec709.xy).inverse();

  std::array<float, 9> matrix;
  bool identity = true;
  for (int r = 0; r < 3; ++r) {
    for (int k = 0; k < 3; ++k) {
      const double v = m[k][r];  // transposed: for column vectors
      if (!(std::abs(v) <= kMaxEntry)) return unusable(from);
      if (std::abs(v - (r == k ? 1.0 : 0.0)) > 1e-5) identity = false;
      matrix[static_cast<size_t>(3 * r + k)] = static_cast<float>(v);
    }
  }
  if (identity) return std::nullopt;
  return matrix;
}

absl::StatusOr<std::optional<std::array<float, 9>>> scene_matrix(const v1::Settings& settings) {
  const bool named = settings.input_primaries() != v1::PRIMARIES_UNSPECIFIED;
  std::optional<White> white;
  if (settings.has_white_balance()) white = white_of(settings.white_balance(), settings.tint());
  if (named) return matrix_to_rec709(chromaticities(settings.input_primaries()), white);
  if (settings.has_input_chromaticities()) {
    return matrix_to_rec709(chromaticities(settings.input_chromaticities()), white);
  }
  if (!white) return std::nullopt;
  return matrix_to_rec709(chromaticities(v1::PRIMARIES_REC709), white);
}

}  // namespace candela
