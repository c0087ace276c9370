#include "server/render/color/primaries.h"

#include <ImathMatrix.h>
#include <ImathVec.h>

#include <array>
#include <cmath>
#include <iterator>

#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "server/render/color/portable_math.h"

namespace candela {
namespace {

// The colour of a black body.

// The colour-matching functions of the CIE 1931 standard observer (2 degrees), from kFirstMetres on. z ends
// where it becomes 0. Source: CIE 015:2018, table 4.
constexpr double kX[] = {
    0.001368, 0.002236, 0.004243, 0.00765,  0.01431, 0.02319, 0.04351, 0.07763,  0.13438,  0.21477,  0.2839,
    0.3285,   0.34828,  0.34806,  0.3362,   0.3187,  0.2908,  0.2511,  0.19536,  0.1421,   0.09564,  0.05795,
    0.03201,  0.0147,   0.0049,   0.0024,   0.0093,  0.0291,  0.06327, 0.1096,   0.1655,   0.22575,  0.2904,
    0.3597,   0.43345,  0.51205,  0.5945,   0.6784,  0.7621,  0.8425,  0.9163,   0.9786,   1.0263,   1.0567,
    1.0622,   1.0456,   1.0026,   0.9384,   0.85445, 0.7514,  0.6424,  0.5419,   0.4479,   0.3608,   0.2835,
    0.2187,   0.1649,   0.1212,   0.0874,   0.0636,  0.04677, 0.0329,  0.0227,   0.01584,  0.011359, 0.008111,
    0.00579,  0.004109, 0.002899, 0.002049, 0.00144, 0.001,   0.00069, 0.000476, 0.000332, 0.000235, 0.000166,
    0.000117, 0.000083, 0.000059, 0.000042};
constexpr double kY[] = {
    0.000039, 0.000064, 0.00012,  0.000217, 0.000396, 0.00064,  0.00121, 0.00218,  0.004,
    0.0073,   0.0116,   0.01684,  0.023,    0.0298,   0.038,    0.048,   0.06,     0.0739,
    0.09098,  0.1126,   0.13902,  0.1693,   0.20802,  0.2586,   0.323,   0.4073,   0.503,
    0.6082,   0.71,     0.7932,   0.862,    0.91485,  0.954,    0.9803,  0.99495,  1,
    0.995,    0.9786,   0.952,    0.9154,   0.87,     0.8163,   0.757,   0.6949,   0.631,
    0.5668,   0.503,    0.4412,   0.381,    0.321,    0.265,    0.217,   0.175,    0.1382,
    0.107,    0.0816,   0.061,    0.04458,  0.032,    0.0232,   0.017,   0.01192,  0.00821,
    0.005723, 0.004102, 0.002929, 0.002091, 0.001484, 0.001047, 0.00074, 0.00052,  0.000361,
    0.000249, 0.000172, 0.00012,  0.000085, 0.00006,  0.000042, 0.00003, 0.000021, 0.000015};
constexpr double kZ[] = {0.00645, 0.01055, 0.02005, 0.03621, 0.06785, 0.1102,  0.2074,  0.3713,  0.6456,
                         1.03905, 1.3856,  1.62296, 1.74706, 1.7826,  1.77211, 1.7441,  1.6692,  1.5281,
                         1.28764, 1.0419,  0.81295, 0.6162,  0.46518, 0.3533,  0.272,   0.2123,  0.1582,
                         0.1117,  0.07825, 0.05725, 0.04216, 0.02984, 0.0203,  0.0134,  0.00875, 0.00575,
                         0.0039,  0.00275, 0.0021,  0.0018,  0.00165, 0.0014,  0.0011,  0.001,   0.0008,
                         0.0006,  0.00034, 0.00024, 0.00019, 0.0001,  0.00005, 0.00003, 0.00002, 0.00001};
static_assert(std::size(kX) == std::size(kY) && std::size(kZ) < std::size(kX));
constexpr double kFirstMetres = 380e-9;
constexpr double kStepMetres = 5e-9;
// The second radiation constant, h c / k.
constexpr double kSecondConstant = 1.4388e-2;  // m K

// CIE 1931 XYZ of the light of a black body at this temperature, above 0 K, up to a factor. It is Planck's
// law itself, summed over the colour-matching functions of the 2-degree observer at steps of 5 nm, so it is
// as smooth as the law.
std::array<double, 3> planckian_xyz(double kelvin) {
  std::array<double, 3> xyz{};
  for (size_t i = 0; i < std::size(kX); ++i) {
    const double wavelength = kFirstMetres + kStepMetres * static_cast<double>(i);
    const double length = wavelength / kFirstMetres;
    const double light = 1 / (length * length * length * length * length *
                              portable_expm1(kSecondConstant / (wavelength * kelvin)));
    xyz[0] += light * kX[i];
    xyz[1] += light * kY[i];
    if (i < std::size(kZ)) xyz[2] += light * kZ[i];
  }
  return xyz;
}

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
