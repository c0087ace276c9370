#include "server/render/reference/environment_error.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "server/base/slices.h"

namespace candela {
namespace {

using reference::Direction;
using reference::Rgb;

constexpr int kDirections = 64;
constexpr uint32_t kReferenceSamples = 16;  // of a panorama whose texels are as large as those of level 0

Direction spread(int i) {
  const double y = 1 - (2.0 * i + 1) / kDirections;
  const double lon = i * std::numbers::pi * (3 - std::sqrt(5.0));
  const double r = std::sqrt(1 - y * y);
  return {r * std::sin(lon), y, -r * std::cos(lon)};
}

// The mean of P over a texel, by the sub-texels of the tier `reference`.
Rgb mean_of(const reference::Scene& panorama, uint32_t face, uint32_t i, uint32_t j, uint32_t size,
            double rotation_deg) {
  const uint32_t k = kReferenceSamples * ((panorama.width + 4 * size - 1) / (4 * size));
  const double step = 2.0 / size / k;
  const double samples = static_cast<double>(k) * k;
  Rgb sum{};
  for (uint32_t b = 0; b < k; ++b) {
    for (uint32_t a = 0; a < k; ++a) {
      const Direction d = reference::cube_point(
          {face, 2.0 * i / size - 1 + (a + 0.5) * step, 2.0 * j / size - 1 + (b + 0.5) * step});
      const Rgb p = reference::panorama_at(panorama, reference::turned_back(d, rotation_deg));
      for (size_t c = 0; c < 3; ++c) sum[c] += p[c] / samples;
    }
  }
  return sum;
}

uint32_t texel_of(double s, uint32_t size) {
  return std::min(size - 1, static_cast<uint32_t>((s + 1) / 2 * size));
}

}  // namespace

double level_error(const reference::Scene& panorama, const BakedFaces& level, double rotation_deg) {
  double error = 0.0;
  double light = 0.0;
  for (int k = 0; k < kDirections; ++k) {
    const reference::CubeSpot spot = reference::cube_spot(spread(k));
    const uint32_t i = texel_of(spot.s, level.size);
    const uint32_t j = texel_of(spot.t, level.size);
    const Direction n = reference::cube_direction(spot.face, i, j, level.size);
    const Rgb exact =
        level.roughness == 0.0
            ? mean_of(panorama, spot.face, i, j, level.size, rotation_deg)
            : reference::specular_at(panorama, reference::turned_back(n, rotation_deg), level.roughness);
    const float* baked = &level.faces[spot.face][3 * (size_t{j} * level.size + i)];
    for (size_t c = 0; c < 3; ++c) {
      error += std::abs(baked[c] - exact[c]);
      light += std::abs(exact[c]);
    }
    checkpoint();
  }
  return light > 0.0 ? error / light : 0.0;
}

}  // namespace candela
