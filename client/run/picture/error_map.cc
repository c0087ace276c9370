#include "client/run/picture/error_map.h"

#include <half.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "absl/strings/str_format.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

using Color = std::array<uint8_t, 3>;

// Nine even steps of the perceptually uniform colour map Inferno
// by N. Smith and S. van der Walt (matplotlib, CC0).
constexpr Color kInferno[] = {{0, 0, 4},     {33, 12, 74},   {87, 16, 110},  {138, 34, 106}, {188, 55, 84},
                              {227, 89, 51}, {249, 140, 10}, {249, 201, 50}, {252, 255, 164}};
constexpr int kSteps = static_cast<int>(std::size(kInferno)) - 1;

// The colour of a position 0 .. 1 on the scale.
Color inferno(double t) {
  const double at = std::clamp(t, 0.0, 1.0) * kSteps;
  const int step = std::min(static_cast<int>(at), kSteps - 1);
  Color color;
  for (size_t k = 0; k < 3; ++k) {
    color[k] =
        static_cast<uint8_t>(std::lround(std::lerp(kInferno[step][k], kInferno[step + 1][k], at - step)));
  }
  return color;
}

// A power of ten without an exponent: "0.00001", "10".
std::string power_of_ten(double value) {
  const int exponent = static_cast<int>(std::lround(std::log10(value)));
  return absl::StrFormat("%.*f", std::max(0, -exponent), value);
}

double decades() { return std::log10(kMostErrorCodes / kLeastErrorCodes); }

Color color_of(double codes) {
  return codes > kLeastErrorCodes ? inferno(std::log10(codes / kLeastErrorCodes) / decades()) : inferno(0.0);
}

// The labels of the legend are powers of ten, made of three
// glyphs of 3 x 5 dots. Each row of a glyph is 3 bits.
constexpr std::array<uint8_t, 5> kZero = {7, 5, 5, 5, 7};
constexpr std::array<uint8_t, 5> kOne = {2, 6, 2, 2, 7};
constexpr std::array<uint8_t, 5> kPoint = {0, 0, 0, 0, 2};
constexpr uint32_t kGlyphDots = 4;  // including the gap
// The legend's rows in dots: a gap, the colours, a gap, the labels, a gap.
constexpr uint32_t kBarTop = 1;
constexpr uint32_t kBarEnd = 6;
constexpr uint32_t kLabelTop = 7;
constexpr uint32_t kLegendDots = 13;
constexpr uint32_t kLegendWidthDots = 240;  // the width of the labels; the size of a dot grows with the map

class Canvas {
 public:
  explicit Canvas(Image& image) : image_(image) {}

  void set(uint32_t x, uint32_t y, const Color& color) {
    std::byte* texel = image_.pixels.data() + y * image_.row_bytes() + size_t{x} * 4;
    for (size_t k = 0; k < 3; ++k) texel[k] = std::byte{color[k]};
    texel[3] = std::byte{255};
  }

  void fill(uint32_t x, uint32_t y, uint32_t width, uint32_t height, const Color& color) {
    for (uint32_t j = y; j < y + height; ++j) {
      for (uint32_t i = x; i < x + width; ++i) set(i, j, color);
    }
  }

  void write(const std::string& label, uint32_t x, uint32_t y, uint32_t dot) {
    for (const char c : label) {
      const std::array<uint8_t, 5>& glyph = c == '0' ? kZero : c == '1' ? kOne : kPoint;
      for (uint32_t j = 0; j < glyph.size(); ++j) {
        for (uint32_t i = 0; i < 3; ++i) {
          if (glyph[j] >> (2 - i) & 1) fill(x + i * dot, y + j * dot, dot, dot, {255, 255, 255});
        }
      }
      x += kGlyphDots * dot;
    }
  }

 private:
  Image& image_;
};

void draw_legend(Canvas& canvas, uint32_t width, uint32_t top, uint32_t dot) {
  for (uint32_t x = 0; x < width; ++x) {
    const Color color = inferno((x + 0.5) / width);
    canvas.fill(x, top + kBarTop * dot, 1, (kBarEnd - kBarTop) * dot, color);
  }
  const auto last = static_cast<int>(std::lround(decades()));
  for (int i = 0; i <= last; ++i) {
    const std::string label = power_of_ten(kLeastErrorCodes * std::pow(10.0, i));
    const uint32_t wide = static_cast<uint32_t>(label.size()) * kGlyphDots * dot;
    const double centre = static_cast<double>(width) * i / last;
    const double left = std::clamp(centre - wide / 2.0, 0.0, static_cast<double>(width - wide));
    canvas.write(label, static_cast<uint32_t>(left), top + kLabelTop * dot, dot);
  }
}

}  // namespace

std::string error_scale_words() {
  return absl::StrFormat("codes on a log scale, %s or less black, %s or more pale yellow",
                         power_of_ten(kLeastErrorCodes), power_of_ten(kMostErrorCodes));
}

absl::StatusOr<Image> draw_error_map(std::span<const uint16_t> halves, uint32_t width, uint32_t height) {
  const uint32_t dot = std::max<uint32_t>(1, width * 3 / (4 * kLegendWidthDots));
  const uint32_t wide = std::max(width, kLegendWidthDots);
  absl::StatusOr<Image> image = make_image(wide, height + kLegendDots * dot, ImageFormat::kRgba8);
  if (!image.ok()) return image;
  Canvas canvas(*image);
  canvas.fill(0, 0, image->width, image->height, {32, 32, 32});
  for (uint32_t y = 0; y < height; ++y) {
    for (uint32_t x = 0; x < width; ++x) {
      canvas.set(x, y, color_of(imath_half_to_float(halves[size_t{y} * width + x])));
    }
  }
  draw_legend(canvas, wide, height, dot);
  return image;
}

absl::Status write_error_map(const std::string& path, std::span<const uint16_t> halves, uint32_t width,
                             uint32_t height) {
  ASSIGN_OR_RETURN(const Image map, draw_error_map(halves, width, height));
  return write_image(path, map, {.text = {{"Description", error_scale_words()}}}).status();
}

}  // namespace candela
