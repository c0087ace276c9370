#include "shaders/reference.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace candela::reference {
namespace {

size_t clamped_index(int64_t x, int64_t y, uint32_t width, uint32_t height) {
  const int64_t cx = std::clamp<int64_t>(x, 0, int64_t{width} - 1);
  const int64_t cy = std::clamp<int64_t>(y, 0, int64_t{height} - 1);
  return static_cast<size_t>(cy) * width + static_cast<size_t>(cx);
}

}  // namespace

const std::array<float, 4>& Scene::at(int64_t x, int64_t y) const {
  return texels[clamped_index(x, y, width, height)];
}

const Rgb& Level::at(int64_t x, int64_t y) const { return texels[clamped_index(x, y, width, height)]; }

// Twin of table.glsl: the table's look-up.

Rgb look_up(const ColorTable& table, const Rgb& exposed) {
  static constexpr double kFromScene[] = {TABLE_FROM_SCENE};
  static constexpr double kFromSceneAp1[] = {TABLE_FROM_SCENE_AP1};
  static constexpr double kDesaturation[] = {RRT_DESATURATION};
  static constexpr double kToDisplay[] = {TABLE_TO_DISPLAY};
  static constexpr double kIdentity[] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
  const bool rec709 = table.axes == shader::AXES_REC709;
  const bool ap1 = table.axes == shader::AXES_AP1;
  const double* const from_scene = rec709 ? kIdentity : ap1 ? kFromSceneAp1 : kFromScene;
  const double* const to_display = rec709 ? kIdentity : kToDisplay;
  const double knee = ap1 ? shader::TABLE_AXIS_KNEE_AP1 : shader::TABLE_AXIS_KNEE;
  const auto octaves = [knee](double light) {
    const double x = light / knee + 1.0;
    const double e = std::floor(std::log2(x));
    const double m = x / std::exp2(e) - 1.0;
    return e + m * (4.0 - m) / 3.0;
  };
  struct Axis {
    double fraction;
    size_t step;  // in points, to the next one of this axis
  };
  std::array<Axis, 3> axes;
  size_t point = 0;
  size_t step = 1;
  Rgb light{};
  for (size_t k = 0; k < 3; ++k) {
    for (size_t c = 0; c < 3; ++c) light[k] += from_scene[3 * k + c] * exposed[c];
  }
  for (size_t k = 0; k < 3; ++k) {
    double v = std::clamp(light[k], 0.0, double{table.end});
    for (size_t c = 0; ap1 && c < 3; ++c) {
      if (c != k) v += kDesaturation[c] * std::max(light[c] - table.end, 0.0);
    }
    v = std::min<double>(v, table.end);
    const double position = octaves(v) / octaves(table.end) * (table.size - 1);
    const double cell = std::clamp(std::floor(position), 0.0, table.size - 2.0);
    axes[k] = {position - cell, step};
    point += static_cast<size_t>(cell) * step;
    step *= table.size;
  }

  // From the cell's first corner to its last, along the axis with the largest fraction first.
  std::sort(axes.begin(), axes.end(), [](const Axis& a, const Axis& b) { return a.fraction > b.fraction; });
  const auto root = [&table](size_t at, size_t k) {
    return table.values[3 * at + k] / 65535.0 * shader::TABLE_MAX_ROOT;
  };
  for (size_t k = 0; k < 3; ++k) {
    size_t at = point;
    double before = root(at, k);
    double sum = before;
    for (const Axis& axis : axes) {
      at += axis.step;
      const double here = root(at, k);
      sum += axis.fraction * (here - before);
      before = here;
    }
    light[k] = sum * sum;
  }
  Rgb out{};
  for (size_t r = 0; r < 3; ++r) {
    for (size_t c = 0; c < 3; ++c) out[r] += to_display[3 * r + c] * light[c];
  }
  return out;
}

}  // namespace candela::reference
