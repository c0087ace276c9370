#include "shaders/color_table.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace candela {

namespace {

using Vector = std::array<double, 3>;
using Matrix = std::array<double, 9>;  // row by row

constexpr Matrix kFromScene = {TABLE_FROM_SCENE};
constexpr Matrix kFromSceneAp1 = {TABLE_FROM_SCENE_AP1};
constexpr Vector kDesaturation = {RRT_DESATURATION};
constexpr Matrix kToDisplay = {TABLE_TO_DISPLAY};
constexpr Matrix kIdentity = {1, 0, 0, 0, 1, 0, 0, 0, 1};

const Matrix& from_scene(uint32_t axes) {
  if (axes == shader::AXES_AP1) return kFromSceneAp1;
  return axes == shader::AXES_REC709 ? kIdentity : kFromScene;
}
const Matrix& to_display(uint32_t axes) { return axes == shader::AXES_REC709 ? kIdentity : kToDisplay; }

double knee(uint32_t axes) {
  return axes == shader::AXES_AP1 ? shader::TABLE_AXIS_KNEE_AP1 : shader::TABLE_AXIS_KNEE;
}

constexpr double kMinLight = -0.5;
constexpr double kMaxLight = 1.5;

Matrix inverse(const Matrix& m) {
  Matrix out;
  double determinant = 0.0;
  for (size_t r = 0; r < 3; ++r) {
    const size_t r1 = (r + 1) % 3;
    const size_t r2 = (r + 2) % 3;
    for (size_t c = 0; c < 3; ++c) {
      const size_t c1 = (c + 1) % 3;
      const size_t c2 = (c + 2) % 3;
      out[3 * c + r] = m[3 * r1 + c1] * m[3 * r2 + c2] - m[3 * r1 + c2] * m[3 * r2 + c1];
    }
    determinant += m[r] * out[3 * r];
  }
  for (double& v : out) v /= determinant;
  return out;
}

Vector multiply(const Matrix& m, const Vector& v) {
  Vector out{};
  for (size_t r = 0; r < 3; ++r) {
    for (size_t c = 0; c < 3; ++c) out[r] += m[3 * r + c] * v[c];
  }
  return out;
}

uint16_t pack(double light) {
  const double unit = std::sqrt(std::max(light, 0.0)) / shader::TABLE_MAX_ROOT;
  return static_cast<uint16_t>(std::lround(std::min(unit, 1.0) * 65535.0));
}

}  // namespace

double table_octaves(double x) {
  int exponent = 0;
  const double mantissa = 2.0 * std::frexp(x, &exponent) - 1.0;
  return exponent - 1 + mantissa * (4.0 - mantissa) / 3.0;
}

std::array<float, 3> light_within_axes(const std::array<float, 3>& light, uint32_t axes, float end) {
  Vector v = multiply(from_scene(axes), {light[0], light[1], light[2]});
  if (axes == shader::AXES_AP1) {
    Vector beyond;
    for (size_t k = 0; k < 3; ++k) beyond[k] = kDesaturation[k] * std::max(v[k] - end, 0.0);
    for (size_t k = 0; k < 3; ++k) {
      v[k] = std::clamp(v[k], 0.0, double{end}) + beyond[(k + 1) % 3] + beyond[(k + 2) % 3];
    }
  }
  for (double& c : v) c = std::clamp(c, 0.0, double{end});
  v = multiply(inverse(from_scene(axes)), v);
  return {static_cast<float>(v[0]), static_cast<float>(v[1]), static_cast<float>(v[2])};
}

double table_axis_octaves(uint32_t axes, float end) { return table_octaves(end / knee(axes) + 1.0); }

double table_axis_value(uint32_t i, uint32_t size, float end, uint32_t axes) {
  if (i == size - 1) return end;
  const double octaves = table_axis_octaves(axes, end) * i / (size - 1);
  const double whole = std::floor(octaves);
  const double mantissa = 2.0 - std::sqrt(4.0 - 3.0 * (octaves - whole));
  return knee(axes) * (std::ldexp(1.0 + mantissa, static_cast<int>(whole)) - 1.0);
}

std::vector<float> lattice_light(uint32_t size, uint32_t axes, float end) {
  const Matrix to_scene = inverse(from_scene(axes));
  std::vector<double> axis(size);
  for (uint32_t i = 0; i < size; ++i) axis[i] = table_axis_value(i, size, end, axes);
  std::vector<float> rgb;
  rgb.reserve(size_t{size} * size * size * 3);
  for (const double b : axis) {
    for (const double g : axis) {
      for (const double r : axis) {
        for (const double v : multiply(to_scene, {r, g, b})) rgb.push_back(static_cast<float>(v));
      }
    }
  }
  return rgb;
}

ColorTable make_color_table(uint32_t size, uint32_t axes, float end, std::span<const float> display_light) {
  const Matrix from_display = inverse(to_display(axes));
  ColorTable table{size, axes, end, std::vector<uint16_t>(display_light.size())};
  for (size_t i = 0; i < display_light.size(); i += 3) {
    Vector light{display_light[i], display_light[i + 1], display_light[i + 2]};
    // NaN becomes the lowest value.
    for (double& v : light) v = v > kMinLight ? std::min(v, kMaxLight) : kMinLight;
    light = multiply(from_display, light);
    for (size_t k = 0; k < 3; ++k) table.values[i + k] = pack(light[k]);
  }
  return table;
}

}  // namespace candela
