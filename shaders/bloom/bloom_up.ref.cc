// Twin of bloom_up.comp: the 3x3 tent over bilinear samples, added to the finer level. Also the whole chain.
#include <algorithm>
#include <cmath>
#include <utility>

#include "shaders/reference.h"

namespace candela::reference {

Level bloom_up(Level fine, const Level& coarse, double weight) {
  static constexpr double kTent[3] = {1.0, 2.0, 1.0};
  for (uint32_t y = 0; y < fine.height; ++y) {
    for (uint32_t x = 0; x < fine.width; ++x) {
      Rgb& b = fine.texels[size_t{y} * fine.width + x];
      for (double& v : b) v *= weight;
      const double u = (x + 0.5) / 2.0 - 0.5;
      const double v = (y + 0.5) / 2.0 - 0.5;
      for (int j = -1; j <= 1; ++j) {
        for (int i = -1; i <= 1; ++i) {
          const Rgb s = bilinear(coarse, u + i, v + j);
          for (int n = 0; n < 3; ++n) b[n] += kTent[i + 1] * kTent[j + 1] / 16.0 * s[n];
        }
      }
    }
    row_done();
  }
  return fine;
}

namespace {

// Half the size: means of 2x2 texels.
Level quarter(const Level& level) {
  Level out{(level.width + 1) / 2, (level.height + 1) / 2, {}};
  out.texels.reserve(size_t{out.width} * out.height);
  for (int64_t y = 0; y < out.height; ++y) {
    for (int64_t x = 0; x < out.width; ++x) {
      Rgb& mean = out.texels.emplace_back();
      for (int64_t i = 0; i < 4; ++i) {
        const Rgb& c = level.at(2 * x + i % 2, 2 * y + i / 2);
        for (size_t n = 0; n < 3; ++n) mean[n] += 0.25 * c[n];
      }
    }
    row_done();
  }
  return out;
}

}  // namespace

Level bloom(const Scene& scene, const BloomSpec& params, double mean_log2_luminance, uint32_t* level_count) {
  if (params.kind == shader::BLOOM_GAUSSIAN) {
    *level_count = 1;
    return gaussian_bloom(scene, params.threshold * std::exp2(mean_log2_luminance));
  }
  std::vector<Level> levels;
  levels.push_back(bright_pass(scene, params));
  uint32_t most = params.levels;
  if (params.level_size == 4) {
    levels[0] = quarter(levels[0]);
    most = std::max(most, 2u) - 1;
  }
  // A level has a next one if its short side has more than two texels.
  while (levels.size() < most && std::min(levels.back().width, levels.back().height) > 2) {
    levels.push_back(bloom_down(levels.back()));
  }
  // The finest level of size 4 stands for two levels and counts twice, unless it is the only one.
  const bool twice = params.level_size == 4 && levels.size() > 1;
  *level_count = static_cast<uint32_t>(levels.size()) + twice;
  while (levels.size() > 1) {
    const Level coarse = std::move(levels.back());
    levels.pop_back();
    levels.back() = bloom_up(std::move(levels.back()), coarse, twice && levels.size() == 1 ? 2.0 : 1.0);
  }
  return std::move(levels.front());
}

}  // namespace candela::reference
