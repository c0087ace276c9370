#include "tests/support/scenes.h"

#include <half.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

namespace candela::testing {

namespace {

uint32_t pack_rgb9e5(const Texel& c) {
  const float largest = std::max({c[0], c[1], c[2], 0.0f});
  int exponent = largest > 0 ? std::max(-16, std::ilogb(largest)) + 1 : -15;
  if (std::round(std::ldexp(largest, 9 - exponent)) > 511) ++exponent;
  uint32_t word = static_cast<uint32_t>(std::min(exponent + 15, 31)) << 27;
  for (int k = 0; k < 3; ++k) {
    const float mantissa =
        std::round(std::ldexp(std::clamp(c[static_cast<size_t>(k)], 0.0f, 65408.0f), 9 - exponent));
    word |= static_cast<uint32_t>(std::clamp(mantissa, 0.0f, 511.0f)) << (9 * k);
  }
  return word;
}

Texel natural_texel(uint32_t width, uint32_t height, uint32_t x, uint32_t y) {
  const float u = (static_cast<float>(x) + 0.5f) / static_cast<float>(width);
  const float v = (static_cast<float>(y) + 0.5f) / static_cast<float>(height);
  const float light = std::exp2(14.0f * u - 10.0f) * (0.7f + 0.6f * noise(x, y, 3));
  Texel c = {light * (0.2f + v), light * 0.6f, light * (1.2f - v), 0.25f + 0.5f * v};
  if (noise(x / 5, y / 5, 7) > 0.995f) c = {1000.0f * noise(x / 5, y / 5, 8), 300.0f, 40.0f, 1.0f};
  if (noise(x / 7, y / 3, 9) > 0.98f) c[2] = -0.05f * light;
  return c;
}

constexpr uint32_t kTile = 64;
bool near_the_middle(uint32_t i) { return i >= kTile / 2 - 8 && i < kTile / 2 + 8; }

}  // namespace

WireFrame make_frame(uint32_t width, uint32_t height, PixelFormat format, const TexelFunction& texel) {
  WireFrame frame{{width, height, format}, {}};
  frame.pixels.resize(frame.desc.bytes());
  std::byte* out = frame.pixels.data();
  for (uint32_t y = 0; y < height; ++y) {
    for (uint32_t x = 0; x < width; ++x, out += bytes_per_pixel(format)) {
      const Texel c = texel(x, y);
      if (format == PixelFormat::kRgba32f) {
        std::memcpy(out, c.data(), 16);
      } else if (format == PixelFormat::kRgba16f) {
        std::array<uint16_t, 4> half;
        for (size_t k = 0; k < 4; ++k) half[k] = imath_float_to_half(c[k]);
        std::memcpy(out, half.data(), 8);
      } else {
        const uint32_t word = pack_rgb9e5(c);
        std::memcpy(out, &word, 4);
      }
    }
  }
  return frame;
}

float noise(uint32_t x, uint32_t y, uint32_t channel) {
  // PCG hash (Jarzynski and Olano, "Hash Functions for GPU Rendering", 2020).
  uint32_t v = x + 4099u * y + 16777259u * channel;
  v = v * 747796405u + 2891336453u;
  v = ((v >> ((v >> 28) + 4u)) ^ v) * 277803737u;
  v = (v >> 22) ^ v;
  return static_cast<float>(v >> 8) * 0x1p-24f;
}

WireFrame natural(uint32_t width, uint32_t height, PixelFormat format) {
  return make_frame(width, height, format,
                    [=](uint32_t x, uint32_t y) { return natural_texel(width, height, x, y); });
}

WireFrame lit_tiles(uint32_t width, uint32_t height) {
  constexpr uint32_t kOneIn = 100;
  const uint32_t across = (width + kTile - 1) / kTile;
  return make_frame(width, height, PixelFormat::kRgba16f, [=](uint32_t x, uint32_t y) -> Texel {
    const bool lit_tile = (y / kTile * across + x / kTile) % kOneIn == kOneIn / 2;
    if (lit_tile && near_the_middle(x % kTile) && near_the_middle(y % kTile)) {
      return {60000.0f, 60000.0f, 60000.0f, 1.0f};
    }
    return natural_texel(width, height, x, y);
  });
}

WireFrame flat(uint32_t width, uint32_t height, Texel value, PixelFormat format) {
  return make_frame(width, height, format, [=](uint32_t, uint32_t) { return value; });
}

std::vector<HardCase> hard_cases(uint32_t width, uint32_t height) {
  constexpr float kInf = std::numeric_limits<float>::infinity();
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
  constexpr float kMax = 65504.0f;
  const auto everywhere = [](float v) -> TexelFunction {
    return [=](uint32_t, uint32_t) -> Texel { return {v, v, v, v}; };
  };
  const auto alone = [=](float v) -> TexelFunction {
    return [=](uint32_t x, uint32_t y) -> Texel {
      const float c = x == width / 2 && y == height / 2 ? v : 0.18f;
      return {c, c, c, 1.0f};
    };
  };
  return {
      {"all black", everywhere(0.0f)},
      {"all 65504", everywhere(kMax)},
      {"all -65504", everywhere(-kMax)},
      {"all NaN", everywhere(kNan)},
      {"all +Inf", everywhere(kInf)},
      {"all -Inf", everywhere(-kInf)},
      {"all smallest half", everywhere(0x1p-24f)},
      {"one 65504 on 1e-4",
       [=](uint32_t x, uint32_t y) -> Texel {
         const float c = x == width / 2 && y == height / 2 ? kMax : 1e-4f;
         return {c, c, c, 1.0f};
       }},
      {"one NaN", alone(kNan)},
      {"one +Inf", alone(kInf)},
      {"one -Inf", alone(-kInf)},
      {"one negative", alone(-3.0f)},
      {"one denormal", alone(0x1p-20f)},
      {"checkerboard of 0 and 65504",
       [=](uint32_t x, uint32_t y) -> Texel {
         const float c = (x + y) % 2 == 0 ? 0.0f : kMax;
         return {c, c, c, 1.0f};
       }},
      {"saturated and negative",
       [=](uint32_t x, uint32_t y) -> Texel {
         return {x % 3 == 0 ? kMax : -kMax, y % 3 == 0 ? 100.0f : -0.5f, (x + y) % 5 == 0 ? kMax : 0.0f,
                 -1.0f};
       }},
  };
}

}  // namespace candela::testing
