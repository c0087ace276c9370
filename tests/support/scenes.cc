#include "tests/support/scenes.h"

#include <half.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <utility>

#include "proto/candela/v1/pixel_size.h"

namespace candela::testing {

WireFrame make_frame(uint32_t width, uint32_t height, v1::PixelFormat format, const TexelFunction& texel) {
  WireFrame frame{{width, height, format}, {}};
  frame.pixels.resize(frame.desc.bytes());
  std::byte* out = frame.pixels.data();
  for (uint32_t y = 0; y < height; ++y) {
    for (uint32_t x = 0; x < width; ++x, out += bytes_per_pixel(format)) {
      const Texel c = texel(x, y);
      if (format == v1::PIXEL_FORMAT_RGBA32F) {
        std::memcpy(out, c.data(), 16);
      } else if (format == v1::PIXEL_FORMAT_RGBA16F) {
        std::array<uint16_t, 4> half;
        for (size_t k = 0; k < 4; ++k) half[k] = imath_float_to_half(c[k]);
        std::memcpy(out, half.data(), 8);
      } else {
        const uint32_t word = v1::pack_rgb9e5({c[0], c[1], c[2]});
        std::memcpy(out, &word, 4);
      }
    }
  }
  return frame;
}

WireFrame chart_of(const std::vector<std::array<float, 3>>& colors, uint32_t width) {
  const auto height = static_cast<uint32_t>((colors.size() + width - 1) / width);
  return make_frame(width, height, v1::PIXEL_FORMAT_RGBA32F, [&](uint32_t x, uint32_t y) -> Texel {
    const size_t i = size_t{y} * width + x;
    return i < colors.size() ? Texel{colors[i][0], colors[i][1], colors[i][2], 1} : Texel{0, 0, 0, 1};
  });
}

TexelFunction ordinary(TexelFunction texel) {
  return [texel = std::move(texel)](uint32_t x, uint32_t y) {
    Texel c = texel(x, y);
    for (float& v : c) v = std::max(v, 0.0f);
    c[3] = 1.0f;
    return c;
  };
}

WireFrame natural(uint32_t width, uint32_t height, v1::PixelFormat format) {
  return make_frame(width, height, format, scenes::natural(width, height));
}

WireFrame lit_tiles(uint32_t width, uint32_t height) {
  return make_frame(width, height, v1::PIXEL_FORMAT_RGBA16F, scenes::lit_tiles(width, height));
}

WireFrame flat(uint32_t width, uint32_t height, Texel value, v1::PixelFormat format) {
  return make_frame(width, height, format, [=](uint32_t, uint32_t) { return value; });
}

WireFrame lights(uint32_t width, uint32_t height, const std::vector<std::pair<uint32_t, uint32_t>>& at,
                 uint32_t size, Texel light, v1::PixelFormat format) {
  return make_frame(width, height, format, [&](uint32_t x, uint32_t y) -> Texel {
    for (const auto& [cx, cy] : at) {
      if (x - cx < size && y - cy < size) return light;
    }
    return {0.2f * noise(x, y, 0), 0.3f * noise(x, y, 1) - 0.05f, 0.1f, 1};
  });
}

std::vector<HardCase> hard_cases(uint32_t width, uint32_t height) {
  constexpr float kMax = 65504.0f;
  std::vector<HardCase> cases = scenes::hard_cases(width, height);
  cases.push_back({"all -65504", "shown black", scenes::everywhere(-kMax)});
  cases.push_back({"saturated and negative", "finite", [](uint32_t x, uint32_t y) -> Texel {
                     return {x % 3 == 0 ? kMax : -kMax, y % 3 == 0 ? 100.0f : -0.5f,
                             (x + y) % 5 == 0 ? kMax : 0.0f, -1.0f};
                   }});
  return cases;
}

}  // namespace candela::testing
