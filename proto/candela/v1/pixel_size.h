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
    case PIXEL_FORMAT_RGB16F:
      return 6;
    case PIXEL_FORMAT_RGB32F:
      return 12;
    default:
      return 0;
  }
}

// The format of the same pixels with an alpha of 1, if `format` has no alpha and is not packed; else
// `format`.
constexpr PixelFormat with_alpha(PixelFormat format) {
  switch (format) {
    case PIXEL_FORMAT_RGB16F:
      return PIXEL_FORMAT_RGBA16F;
    case PIXEL_FORMAT_RGB32F:
      return PIXEL_FORMAT_RGBA32F;
    default:
      return format;
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
