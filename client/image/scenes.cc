#include "client/image/scenes.h"

#include <cmath>
#include <cstdint>
#include <limits>

namespace candela {
namespace {

// A hash of 32-bit numbers, the source of the noise in test scenes.

// PCG. Source: M. Jarzynski and M. Olano, "Hash Functions for GPU Rendering", JCGT 9(3), 2020.
constexpr uint32_t pcg_hash(uint32_t v) {
  v = v * 747796405u + 2891336453u;
  v = ((v >> ((v >> 28) + 4u)) ^ v) * 277803737u;
  return (v >> 22) ^ v;
}

}  // namespace

namespace scenes {
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

// ---- The panorama; angles are in degrees ----

constexpr float kDegree = 0.017453292f;
constexpr float kSunLongitude = 40, kSunLatitude = 35, kSunRadius = 0.27f;
constexpr float kSun = 65504;
constexpr float kWallHalfWidth = 12, kWallTop = 14, kWallFoot = -6;
constexpr float kSquare = 10;

constexpr Texel kWalls[] = {
    {0.7f, 0.04f, 0.03f, 1}, {0.05f, 0.5f, 0.06f, 1}, {0.04f, 0.08f, 0.8f, 1}, {0.7f, 0.5f, 0.02f, 1}};

Texel sky(float lon, float lat) {
  const float a = lat * kDegree, b = kSunLatitude * kDegree;
  const float cosine =
      std::sin(a) * std::sin(b) + std::cos(a) * std::cos(b) * std::cos((lon - kSunLongitude) * kDegree);
  if (cosine > std::cos(kSunRadius * kDegree)) return {kSun, kSun, kSun, 1};
  const float up = std::sqrt(lat / 90), glow = std::exp(60 * (cosine - 1));
  return {0.9f - 0.75f * up + 3 * glow, 0.75f - 0.45f * up + 2.4f * glow, 0.7f + 0.1f * up + 1.6f * glow, 1};
}

Texel ground(float lon, float lat) {
  const int across = static_cast<int>(std::floor(lon / kSquare));
  const int down = static_cast<int>(std::floor(lat / kSquare));
  const float light = (across + down) % 2 == 0 ? 0.16f : 0.08f;
  return {1.1f * light, light, 0.8f * light, 1};
}

// Wall 0 is ahead, and the others follow to the right. `x` is degrees from its middle, to the right.
Texel wall(uint32_t number, float x, float lat) {
  if (x > 8 && lat > 10) return {4, 4, 4, 1};
  for (uint32_t mark = 0; mark <= number; ++mark) {
    const float left = -10 + 4 * static_cast<float>(mark);
    if (x > left && x < left + 2 && lat > -2 && lat < 4) return {0.01f, 0.01f, 0.01f, 1};
  }
  return kWalls[number];
}

Texel panorama_at(float lon, float lat) {
  const float quarter = std::floor((lon + 45) / 90), x = lon - 90 * quarter;
  if (std::fabs(x) < kWallHalfWidth && lat > kWallFoot && lat < kWallTop) {
    return wall(static_cast<uint32_t>(quarter + 4) % 4, x, lat);
  }
  return lat > 0 ? sky(lon, lat) : ground(lon, lat);
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

TexelFunction panorama(uint32_t width, uint32_t height) {
  return [=](uint32_t x, uint32_t y) {
    constexpr uint32_t kSide = 4;  // samples of a texel
    Texel sum{};
    for (uint32_t i = 0; i < kSide * kSide; ++i) {
      const float u = static_cast<float>(x) + (static_cast<float>(i % kSide) + 0.5f) / kSide;
      const float v = static_cast<float>(y) + (static_cast<float>(i / kSide) + 0.5f) / kSide;
      const Texel one = panorama_at(360 * (u / static_cast<float>(width) - 0.5f),
                                    180 * (0.5f - v / static_cast<float>(height)));
      for (size_t c = 0; c < sum.size(); ++c) sum[c] += one[c] / (kSide * kSide);
    }
    return sum;
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

}  // namespace scenes
}  // namespace candela
