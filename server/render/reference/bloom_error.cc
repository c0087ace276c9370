#include "server/render/reference/bloom_error.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>

#include "server/base/slices.h"
#include "shaders/bilinear.h"

namespace candela {

namespace {

// The device's level 0; all zero if it made none.
struct DeviceLevel {
  LevelSize size;
  const std::byte* texels;
  double scale;

  reference::Rgb at(int64_t x, int64_t y) const {
    if (texels == nullptr) return {};
    const auto cx = static_cast<size_t>(std::clamp<int64_t>(x, 0, int64_t{size.width} - 1));
    const auto cy = static_cast<size_t>(std::clamp<int64_t>(y, 0, int64_t{size.height} - 1));
    std::array<float, 4> texel;
    std::memcpy(texel.data(), texels + (cy * size.width + cx) * sizeof texel, sizeof texel);
    return {scale * texel[0], scale * texel[1], scale * texel[2]};
  }
};

}  // namespace

double bloom_error(const ReferenceFrame& truth, const FrameTextures& textures, bool rendered) {
  const TextureLayout& layout = textures.layout;
  if (layout.level_sizes.empty()) return 0.0;
  const DeviceLevel device = {layout.level_sizes[0], rendered ? textures.host_level().mapped() : nullptr,
                              1.0 / layout.summed_levels};
  const reference::Level& level = truth.bloom();
  const bool coarser = device.size.width < level.width || device.size.height < level.height;
  const double step = coarser ? 2.0 : 1.0;
  double largest = 0.0;
  double worst = 0.0;
  for (uint32_t y = 0; y < level.height; ++y) {
    for (uint32_t x = 0; x < level.width; ++x) {
      const reference::Rgb is = reference::bilinear(device, (x + 0.5) / step - 0.5, (y + 0.5) / step - 0.5);
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
