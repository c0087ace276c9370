#include "tests/support/wide_gamut.h"

#include <algorithm>
#include <cmath>
#include <random>

#include "server/render/color/primaries.h"
#include "shaders/reference.h"

namespace candela::testing {

namespace {

Color multiply(const std::array<float, 9>& m, const Color& v) {
  Color out{};
  for (size_t r = 0; r < 3; ++r) {
    for (size_t c = 0; c < 3; ++c) out[r] += m[3 * r + c] * v[c];
  }
  return out;
}

bool inside_ap1(const Color& rec709) {
  const Color ap1 = multiply({TABLE_FROM_SCENE_AP1}, rec709);
  // A component of 0 is not exactly 0 after two matrices.
  return std::min({ap1[0], ap1[1], ap1[2]}) >= -1e-6f * std::max({ap1[0], ap1[1], ap1[2]});
}

}  // namespace

Saturated saturated_inside_ap1(v1::Primaries primaries, size_t count) {
  std::mt19937 random(1);
  const auto uniform = [&random](double low, double high) {
    return low + (high - low) * (static_cast<double>(random()) / 4294967296.0);
  };
  const std::array<float, 9> to_rec709 = **matrix_to_rec709(chromaticities(primaries));
  Saturated colors;
  for (size_t i = 0; colors.own.size() < count; ++i) {
    std::array<double, 3> hue{};
    const size_t at = random() % 3;
    if (i % 3 == 0) {
      const uint32_t pure = 1 + random() % 6;
      for (size_t k = 0; k < 3; ++k) hue[k] = (pure >> k) & 1;
    } else {
      for (double& v : hue) v = uniform(0, 1);
      hue[at] = i % 3 == 1 ? 0.0 : std::exp2(-uniform(0, 10));
    }
    const double light = std::exp2(uniform(-12, 8));
    Color own;
    for (size_t k = 0; k < 3; ++k) own[k] = static_cast<float>(light * hue[k]);
    const Color rec709 = multiply(to_rec709, own);
    if (!inside_ap1(rec709)) continue;
    colors.own.push_back(own);
    colors.rec709.push_back(rec709);
  }
  return colors;
}

double codes_off(double value, double light) {
  return std::abs(value - reference::transfer(shader::TRANSFER_SRGB, std::clamp(light, 0.0, 1.0))) * 255.0;
}

}  // namespace candela::testing
