// RGB9E5: three 9-bit mantissas without a hidden bit and one shared exponent with bias 15, in 32 bits, as in
// Vulkan's E5B9G9R9_UFLOAT_PACK32. Source: the OpenGL extension EXT_texture_shared_exponent.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

namespace candela::v1 {

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
