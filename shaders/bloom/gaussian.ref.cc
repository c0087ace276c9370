// Twin of gaussian.comp, the 13-tap kernel in both directions, and of BLOOM_GAUSSIAN's part of
// bright_pass.comp: the quarter-size mean and its threshold.
#include <algorithm>
#include <cmath>

#include "shaders/reference.h"

namespace candela::reference {

namespace {

constexpr double kKernel[13] = {0.002216, 0.008764, 0.026995, 0.064759, 0.120985, 0.176033, 0.199471,
                                0.176033, 0.120985, 0.064759, 0.026995, 0.008764, 0.002216};

Level blur(const Level& from, int64_t step_x, int64_t step_y) {
  double total = 0.0;
  for (double k : kKernel) total += k;
  Level to{from.width, from.height, {}};
  to.texels.reserve(from.texels.size());
  for (uint32_t y = 0; y < to.height; ++y) {
    for (uint32_t x = 0; x < to.width; ++x) {
      Rgb& mean = to.texels.emplace_back();
      for (int i = 0; i < 13; ++i) {
        const Rgb& c = from.at(x + (i - 6) * step_x, y + (i - 6) * step_y);
        for (size_t n = 0; n < 3; ++n) mean[n] += kKernel[i] / total * c[n];
      }
    }
    row_done();
  }
  return to;
}

}  // namespace

Level gaussian_bloom(const Scene& scene, double threshold) {
  Level level{(scene.width + 3) / 4, (scene.height + 3) / 4, {}};
  level.texels.reserve(size_t{level.width} * level.height);
  for (uint32_t y = 0; y < level.height; ++y) {
    for (uint32_t x = 0; x < level.width; ++x) {
      Rgb& q = level.texels.emplace_back();
      for (int j = 0; j < 4; ++j) {
        for (int i = 0; i < 4; ++i) {
          const auto& c = scene.at(4 * int64_t{x} + i, 4 * int64_t{y} + j);
          for (size_t n = 0; n < 3; ++n) q[n] += std::max(0.0f, c[n]) / 16.0;
        }
      }
      const double gain = std::clamp(luminance(q) - threshold, 0.0, 1.0);
      for (double& v : q) v *= gain;
    }
    row_done();
  }
  return blur(blur(level, 0, 1), 1, 0);
}

}  // namespace candela::reference
