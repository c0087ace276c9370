// The size of the image that is made of a frame.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "candela/v1/render.pb.h"

namespace candela::v1 {

// In pixels.
struct ImageSize {
  uint32_t width = 0;
  uint32_t height = 0;

  bool operator==(const ImageSize&) const = default;
};

// The size that `size` asks for, of a frame; the frame's own if it asks for none. At least 1 a side, and at
// most UINT32_MAX, whatever `size` holds. Pure.
inline ImageSize image_size(const OutputSize& size, ImageSize frame) {
  const auto side = [](double pixels) {  // written so that NaN is 1
    return pixels >= 1 ? static_cast<uint32_t>(std::min<double>(std::floor(pixels + 0.5), UINT32_MAX)) : 1;
  };
  const double width = size.has_pixel_aspect() ? frame.width * size.pixel_aspect() : frame.width;
  const double height = frame.height;
  if (size.width() > 0 && size.height() > 0) return {size.width(), size.height()};
  if (size.width() > 0) return {size.width(), side(height * size.width() / width)};
  if (size.height() > 0) return {side(width * size.height() / height), size.height()};
  if (size.has_percent()) return {side(width * size.percent() / 100), side(height * size.percent() / 100)};
  const double longer = std::max(width, height);
  if (size.max_side() == 0 || longer <= size.max_side()) return {side(width), side(height)};
  return {side(width * size.max_side() / longer), side(height * size.max_side() / longer)};
}

}  // namespace candela::v1
