// The sizes of pixels on the wire.
#pragma once

#include <cstdint>

#include "candela/v1/render.pb.h"

namespace candela::v1 {

// In bytes; 0 for a format that this version does not know.
constexpr uint32_t bytes_per_pixel(PixelFormat format) {
  switch (format) {
    case PIXEL_FORMAT_RGBA16F:
      return 8;
    case PIXEL_FORMAT_RGBA32F:
      return 16;
    case PIXEL_FORMAT_RGB9E5:
      return 4;
    default:
      return 0;
  }
}

constexpr uint32_t bytes_per_pixel(OutputFormat format) {
  switch (format) {
    case OUTPUT_FORMAT_RGBA8:
      return 4;
    case OUTPUT_FORMAT_RGBA16:
    case OUTPUT_FORMAT_RGBA16F:
      return 8;
    default:
      return 0;
  }
}

}  // namespace candela::v1
