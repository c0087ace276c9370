#include "client/run/picture/scene_image.h"

#include <half.h>

#include <cstring>

namespace candela {

absl::StatusOr<Image> scene_image(uint32_t width, uint32_t height, const scenes::TexelFunction& texel) {
  absl::StatusOr<Image> image = make_image(width, height, ImageFormat::kRgba16f);
  if (!image.ok()) return image;
  std::byte* out = image->pixels.data();
  for (uint32_t y = 0; y < height; ++y) {
    for (uint32_t x = 0; x < width; ++x) {
      const scenes::Texel rgba = texel(x, y);
      const half pixel[4] = {half(rgba[0]), half(rgba[1]), half(rgba[2]), half(rgba[3])};
      std::memcpy(out, pixel, sizeof pixel);
      out += sizeof pixel;
    }
  }
  return image;
}

}  // namespace candela
