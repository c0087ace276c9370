// The test scenes of client/image/scenes.h as wire frames of any size and format.
#pragma once

#include <cstddef>
#include <vector>

#include "client/image/scenes.h"
#include "server/render/settings/settings.h"

namespace candela::testing {

inline constexpr ToneCurve kCurves[] = {
    ToneCurve::kLinear,           ToneCurve::kReinhard, ToneCurve::kAcesNarkowicz, ToneCurve::kAcesHill,
    ToneCurve::kReinhardExtended, ToneCurve::kHable,    ToneCurve::kAgx,           ToneCurve::kPbrNeutral};

using scenes::HardCase;
using scenes::noise;
using scenes::Texel;
using scenes::TexelFunction;

struct WireFrame {
  FrameDesc desc;
  std::vector<std::byte> pixels;  // tight rows
};

// Encodes the scene in `format`. RGB9E5 loses negative values and alpha.
WireFrame make_frame(uint32_t width, uint32_t height, PixelFormat format, const TexelFunction& texel);

// scenes::natural().
WireFrame natural(uint32_t width, uint32_t height, PixelFormat format = PixelFormat::kRgba16f);
// scenes::lit_tiles().
WireFrame lit_tiles(uint32_t width, uint32_t height);
// The same value in every texel.
WireFrame flat(uint32_t width, uint32_t height, Texel value, PixelFormat format = PixelFormat::kRgba16f);

// scenes::hard_cases() and two more with large negative values.
std::vector<HardCase> hard_cases(uint32_t width, uint32_t height);

}  // namespace candela::testing
