// Test scenes: frames as functions of the pixel, for tests, benchmarks and the measurement report.
//
// Every function here depends on its arguments alone, so a scene has the same bits on every machine. Values
// are linear scene light; a texel is R, G, B and alpha. Any thread may call them.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

namespace candela::scenes {

using Texel = std::array<float, 4>;
// The texel in column x and row y, counted from the top left.
using TexelFunction = std::function<Texel(uint32_t x, uint32_t y)>;

// Pseudo-random in [0, 1).
float noise(uint32_t x, uint32_t y, uint32_t channel);

// Opaque grey.
Texel grey(float v);

// `v` in all four components of every texel.
TexelFunction everywhere(float v);

// Grey `v` in the middle of a width x height frame, grey `ground` around it.
TexelFunction alone(uint32_t width, uint32_t height, float v, float ground);

// A picture: a gradient from 2^-10 to 2^4 with noise, a few lights up to 1000, saturated colours, and some
// slightly negative components.
TexelFunction natural(uint32_t width, uint32_t height);

// natural() with a light of 60000, 16 texels wide, in the middle of one in a hundred of its 64 x 64 tiles.
// All other light is at most 1000.
TexelFunction lit_tiles(uint32_t width, uint32_t height);

// A panorama in the projection of docs/environments.md section 1: a sky, a sun of 0.27 degrees radius and
// 65504 (the largest half; it would be 1e5) at 40 degrees to the right and 35 up, and a ground of 10 degree
// squares. On the horizon stand four walls of 24 degrees: red ahead, green to the right, blue behind, yellow
// to the left, with one to four dark marks in this order, the first at the left, and a white corner at the
// upper right.
TexelFunction panorama(uint32_t width, uint32_t height);

// A frame on which HDR programs often fail (docs/pipeline.md section 6).
struct HardCase {
  std::string name;
  std::string expected;  // what the pipeline makes of it
  TexelFunction texel;
};
std::vector<HardCase> hard_cases(uint32_t width, uint32_t height);

}  // namespace candela::scenes
