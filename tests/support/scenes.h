// The test scenes of client/image/scenes.h as wire frames of any size and format.
#pragma once

#include <array>
#include <cstddef>
#include <utility>
#include <vector>

#include "client/image/image.h"
#include "client/image/scenes.h"
#include "server/render/settings/settings.h"

namespace candela::testing {

struct Size {
  uint32_t width;
  uint32_t height;
};

inline constexpr v1::ToneCurve kCurves[] = {
    v1::TONE_CURVE_LINEAR,    v1::TONE_CURVE_REINHARD,          v1::TONE_CURVE_ACES_NARKOWICZ,
    v1::TONE_CURVE_ACES_HILL, v1::TONE_CURVE_REINHARD_EXTENDED, v1::TONE_CURVE_HABLE,
    v1::TONE_CURVE_AGX,       v1::TONE_CURVE_PBR_NEUTRAL,       v1::TONE_CURVE_ACES_2,
    v1::TONE_CURVE_BT2390,    v1::TONE_CURVE_SHOULDER};

using scenes::HardCase;
using scenes::noise;
using scenes::Texel;
using scenes::TexelFunction;

struct WireFrame {
  FrameDesc desc;
  std::vector<std::byte> pixels;  // tight rows
};

// Encodes the scene in `format`. RGB9E5 loses negative values and alpha.
WireFrame make_frame(uint32_t width, uint32_t height, v1::PixelFormat format, const TexelFunction& texel);

// Opaque RGBA32F of these colours, row by row; black where they end.
WireFrame chart_of(const std::vector<std::array<float, 3>>& colors, uint32_t width);

// The scene with alpha 1 and its negative components at 0, which most frames have none of.
TexelFunction ordinary(TexelFunction texel);

// scenes::natural(). Its alpha is 0.25 to 1.
WireFrame natural(uint32_t width, uint32_t height, v1::PixelFormat format = v1::PIXEL_FORMAT_RGBA16F);
// scenes::lit_tiles().
WireFrame lit_tiles(uint32_t width, uint32_t height);
// The same value in every texel.
WireFrame flat(uint32_t width, uint32_t height, Texel value,
               v1::PixelFormat format = v1::PIXEL_FORMAT_RGBA16F);

// A dim picture with some negative components, and lights of `size` texels.
WireFrame lights(uint32_t width, uint32_t height, const std::vector<std::pair<uint32_t, uint32_t>>& at,
                 uint32_t size = 3, Texel light = {900, 700, 400, 1},
                 v1::PixelFormat format = v1::PIXEL_FORMAT_RGBA16F);

// An image's own pixels.
inline WireFrame frame_of(const Image& image) {
  const auto pixels = image.pixels.span();
  return {{image.width, image.height,
           image.format == ImageFormat::kRgba16f ? v1::PIXEL_FORMAT_RGBA16F : v1::PIXEL_FORMAT_RGBA32F},
          {pixels.begin(), pixels.end()}};
}

// scenes::hard_cases() and two more with large negative values.
std::vector<HardCase> hard_cases(uint32_t width, uint32_t height);

}  // namespace candela::testing
