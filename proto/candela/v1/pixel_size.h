// The sizes of pixels on the wire, and the format RGB9E5.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

#include "candela/v1/render.pb.h"

namespace candela::v1 {

// The sizes of pixels on the wire.

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

// RGB9E5: three 9-bit mantissas without a hidden bit and one shared exponent with bias 15, in 32 bits, as in
// Vulkan's E5B9G9R9_UFLOAT_PACK32. Source: the OpenGL extension EXT_texture_shared_exponent.

inline constexpr float kMaxRgb9e5 = 65408.0f;  // 511/512 of 2^16

// The nearest word. Components below 0 and NaN become 0, those above kMaxRgb9e5 become kMaxRgb9e5.
inline uint32_t pack_rgb9e5(const std::array<float, 3>& rgb) {
  std::array<float, 3> c;
  for (size_t k = 0; k < 3; ++k) c[k] = rgb[k] > 0 ? std::min(rgb[k], kMaxRgb9e5) : 0.0f;
  const float largest = std::max({c[0], c[1], c[2]});
  int exponent = largest > 0 ? std::max(-16, std::ilogb(largest)) + 1 : -15;
  const auto mantissa = [&exponent](float v) {
    return static_cast<uint32_t>(std::lround(std::ldexp(v, 9 - exponent)));
  };
  if (mantissa(largest) == 512) ++exponent;
  return static_cast<uint32_t>(exponent + 15) << 27 | mantissa(c[2]) << 18 | mantissa(c[1]) << 9 |
         mantissa(c[0]);
}

// Exact, also in halves: every value is a multiple of 2^-24 with nine bits.
inline std::array<float, 3> unpack_rgb9e5(uint32_t word) {
  const int exponent = static_cast<int>(word >> 27) - 15 - 9;
  const auto value = [=](uint32_t mantissa) { return std::ldexp(static_cast<float>(mantissa), exponent); };
  return {value(word & 0x1ff), value(word >> 9 & 0x1ff), value(word >> 18 & 0x1ff)};
}

}  // namespace candela::v1
