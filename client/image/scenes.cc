#include "client/image/scenes.h"

#include <cmath>
#include <limits>

#include "shaders/pcg_hash.h"

namespace candela::scenes {

namespace {

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

float noise(uint32_t x, uint32_t y, uint32_t channel) {
  return static_cast<float>(pcg_hash(x + 4099u * y + 16777259u * channel) >> 8) * 0x1p-24f;
}

Texel grey(float v) { return {v, v, v, 1.0f}; }

TexelFunction everywhere(float v) {
  return [v](uint32_t, uint32_t) -> Texel { return {v, v, v, v}; };
}

TexelFunction alone(uint32_t width, uint32_t height, float v, float ground) {
  return [=](uint32_t x, uint32_t y) { return grey(x == width / 2 && y == height / 2 ? v : ground); };
}

TexelFunction natural(uint32_t width, uint32_t height) {
  return [=](uint32_t x, uint32_t y) { return natural_texel(width, height, x, y); };
}

TexelFunction lit_tiles(uint32_t width, uint32_t height) {
  constexpr uint32_t kOneIn = 100;
  const uint32_t across = (width + kTile - 1) / kTile;
  return [=](uint32_t x, uint32_t y) -> Texel {
    const bool lit_tile = (y / kTile * across + x / kTile) % kOneIn == kOneIn / 2;
    if (lit_tile && near_the_middle(x % kTile) && near_the_middle(y % kTile)) return grey(60000.0f);
    return natural_texel(width, height, x, y);
  };
}

std::vector<HardCase> hard_cases(uint32_t width, uint32_t height) {
  constexpr float kInf = std::numeric_limits<float>::infinity();
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
  constexpr float kMax = 65504.0f;  // the largest half
  const auto one = [=](float v) { return alone(width, height, v, 0.18f); };
  const auto checkerboard = [](uint32_t x, uint32_t y) { return grey((x + y) % 2 == 0 ? 0.0f : kMax); };
  return {
      {"all black", "black at the largest exposure", everywhere(0.0f)},
      {"all 65504", "white at the smallest exposure", everywhere(kMax)},
      {"one 65504 on 1e-4", "sums and bloom stay finite", alone(width, height, kMax, 1e-4f)},
      {"one NaN", "taken as 0", one(kNan)},
      {"all NaN", "taken as 0: black", everywhere(kNan)},
      {"one +Inf", "taken as 65504", one(kInf)},
      {"all +Inf", "taken as 65504: white", everywhere(kInf)},
      {"one -Inf", "taken as -65504, shown as 0", one(-kInf)},
      {"all -Inf", "taken as -65504: black", everywhere(-kInf)},
      {"one negative", "kept, shown as 0", one(-3.0f)},
      {"all negative", "kept, shown black", everywhere(-3.0f)},
      {"one denormal", "kept", one(0x1p-20f)},
      {"all denormal", "metered as 1e-4", everywhere(0x1p-24f)},
      {"checkerboard of 0 and 65504", "sums and bloom stay finite", checkerboard},
  };
}

}  // namespace candela::scenes
