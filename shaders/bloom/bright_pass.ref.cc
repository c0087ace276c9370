// Twin of bright_pass.comp, except for BLOOM_GAUSSIAN, which is in gaussian.ref.cc.
#include <algorithm>

#include "shaders/reference.h"

namespace candela::reference {

Level bright_pass(const Scene& scene, const BloomSpec& params) {
  Level level{(scene.width + 1) / 2, (scene.height + 1) / 2, {}};
  level.texels.reserve(size_t{level.width} * level.height);
  const double knee = params.softness * params.threshold;
  for (uint32_t y = 0; y < level.height; ++y) {
    for (uint32_t x = 0; x < level.width; ++x) {
      Rgb sum{};
      double weights = 0.0;
      for (int j = 0; j < 2; ++j) {
        for (int i = 0; i < 2; ++i) {
          const auto& s = scene.at(2 * int64_t{x} + i, 2 * int64_t{y} + j);
          const Rgb c = {std::max(0.0f, s[0]), std::max(0.0f, s[1]), std::max(0.0f, s[2])};
          const double k = params.firefly_weights && params.kind != shader::BLOOM_CONSERVE
                               ? 1.0 / (1.0 + luminance(c))
                               : 1.0;
          for (int n = 0; n < 3; ++n) sum[n] += k * c[n];
          weights += k;
        }
      }
      Rgb& d = level.texels.emplace_back();
      for (int n = 0; n < 3; ++n) d[n] = sum[n] / weights;
      if (params.kind == shader::BLOOM_CONSERVE) continue;
      const double l = luminance(d);
      const double soft = std::clamp(l - params.threshold + knee, 0.0, 2.0 * knee);
      const double q = knee > 0.0 ? soft * soft / (4.0 * knee) : 0.0;
      const double gain = std::max({q, l - params.threshold, 0.0}) / std::max(l, kMinLuminance);
      for (int n = 0; n < 3; ++n) d[n] *= gain;
    }
    row_done();
  }
  return level;
}

}  // namespace candela::reference
