#include "server/render/reference/bloom_error.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>

#include "server/base/slices.h"
#include "server/render/frame/level_view.h"
#include "shaders/bilinear.h"

namespace candela {

namespace {

// Level 0 as it was drawn; all zero if it was not.
struct DrawnLevel {
  std::optional<LevelView> texels;
  double scale;

  reference::Rgb at(int64_t x, int64_t y) const {
    if (!texels) return {};
    const LevelSize& size = texels->size();
    const auto cx = static_cast<size_t>(std::clamp<int64_t>(x, 0, int64_t{size.width} - 1));
    const auto cy = static_cast<size_t>(std::clamp<int64_t>(y, 0, int64_t{size.height} - 1));
    const std::array<float, 3> texel = texels->at(cx, cy);
    return {scale * texel[0], scale * texel[1], scale * texel[2]};
  }
};

}  // namespace

double bloom_error(const ReferenceFrame& truth, const FrameTextures& textures, bool rendered) {
  const TextureLayout& layout = textures.layout;
  if (layout.level_sizes.empty()) return 0.0;
  const LevelSize& size = layout.level_sizes[0];
  DrawnLevel drawn = {std::nullopt, 1.0 / layout.summed_levels};
  if (rendered) drawn.texels.emplace(textures, size, textures.host_level());
  const reference::Level& level = truth.bloom();
  const bool coarser = size.width < level.width || size.height < level.height;
  const double step = coarser ? 2.0 : 1.0;
  double largest = 0.0;
  double worst = 0.0;
  for (uint32_t y = 0; y < level.height; ++y) {
    for (uint32_t x = 0; x < level.width; ++x) {
      const reference::Rgb is = reference::bilinear(drawn, (x + 0.5) / step - 0.5, (y + 0.5) / step - 0.5);
      const reference::Rgb should = truth.bloom_light(x, y);
      for (size_t k = 0; k < 3; ++k) {
        const double error = std::abs(is[k] - should[k]);
        worst = std::isnan(error) ? std::numeric_limits<double>::infinity() : std::max(worst, error);
        largest = std::max(largest, should[k]);
      }
    }
    checkpoint();
  }
  // Below a float's normal range the device may have flushed everything to 0.
  return worst / std::max<double>(largest, std::numeric_limits<float>::min());
}

}  // namespace candela
