// Wire frames that hurt: deterministic, any size, any format.
#pragma once

#include <array>
#include <cstddef>
#include <functional>
#include <string>
#include <vector>

#include "server/render/settings/settings.h"

namespace candela::testing {

inline constexpr ToneCurve kCurves[] = {
    ToneCurve::kLinear,           ToneCurve::kReinhard, ToneCurve::kAcesNarkowicz, ToneCurve::kAcesHill,
    ToneCurve::kReinhardExtended, ToneCurve::kHable,    ToneCurve::kAgx,           ToneCurve::kPbrNeutral};

using Texel = std::array<float, 4>;
// The texel at (x, y).
using TexelFunction = std::function<Texel(uint32_t x, uint32_t y)>;

struct WireFrame {
  FrameDesc desc;
  std::vector<std::byte> pixels;  // tight rows
};

// Encodes the function's values; to RGB9E5 with negatives and alpha lost.
WireFrame make_frame(uint32_t width, uint32_t height, PixelFormat format, const TexelFunction& texel);

// Pseudo-random in [0, 1), a function of its arguments alone.
float noise(uint32_t x, uint32_t y, uint32_t channel);

// A picture: gradient from 2^-10 to 2^4, noise, a few lights up to 1000, saturated colours, a little
// negative.
WireFrame natural(uint32_t width, uint32_t height, PixelFormat format = PixelFormat::kRgba16f);
// The same with a light of 60000, 16 texels wide, in the middle of one in a hundred of its 64 x 64 tiles;
// nothing else is above 1000.
WireFrame lit_tiles(uint32_t width, uint32_t height);
// One value everywhere.
WireFrame flat(uint32_t width, uint32_t height, Texel value, PixelFormat format = PixelFormat::kRgba16f);

// The hard cases of docs/pipeline.md section 6 that are single frames.
struct HardCase {
  std::string name;
  TexelFunction texel;
};
std::vector<HardCase> hard_cases(uint32_t width, uint32_t height);

}  // namespace candela::testing
