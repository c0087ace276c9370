#include "client/run/picture_error.h"

#include <half.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <vector>

#include "absl/strings/str_format.h"
#include "client/image/color.h"
#include "client/image/power.h"
#include "client/run/picture_frame.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

// Component k of pixel i, 0 .. 1.
double code_of(const Image& picture, size_t i, size_t k) {
  const std::byte* const at = picture.pixels.data();
  if (picture.format == ImageFormat::kRgba8) return std::to_integer<int>(at[4 * i + k]) / 255.0;
  uint16_t code;
  std::memcpy(&code, at + (4 * i + k) * sizeof code, sizeof code);
  return code / 65535.0;
}

struct Worst {
  double max, at_rank;
};

// The largest error, and that of a rank among them all. Moves the errors.
Worst worst_of(std::vector<float>& errors, size_t rank) {
  const auto at = errors.begin() + static_cast<std::ptrdiff_t>(rank);
  std::nth_element(errors.begin(), at, errors.end());
  return {*std::max_element(at, errors.end()), *at};
}

}  // namespace

absl::StatusOr<Image> read_codes(const std::string& path) {
  return read_image(path, default_image_limits(), {.keeps_signal = true});
}

absl::StatusOr<FileError> error_of_file(const std::string& path, const Image& codes, const Image& picture) {
  const size_t pixels = size_t{picture.width} * picture.height;
  if (codes.width != picture.width || codes.height != picture.height ||
      codes.format != ImageFormat::kRgba32f) {
    return absl::InternalError(absl::StrFormat("%s: it was written as %dx%d and read as %dx%d", path,
                                               picture.width, picture.height, codes.width, codes.height));
  }
  std::vector<float> errors;
  errors.reserve(3 * pixels);
  double sum = 0;
  for (size_t i = 0; i < pixels; ++i) {
    if (picture.has_alpha && codes.has_alpha && code_of(picture, i, 3) == 0) continue;
    std::array<float, 4> texel;
    std::memcpy(texel.data(), codes.pixels.data() + i * sizeof texel, sizeof texel);
    for (size_t k = 0; k < 3; ++k) {
      errors.push_back(static_cast<float>(255 * std::abs(double{texel[k]} - code_of(picture, i, k))));
      sum += errors.back();
    }
  }
  if (errors.empty()) return FileError{};
  const auto rank = static_cast<size_t>(static_cast<double>(errors.size() - 1) * 0.999);
  const Worst worst = worst_of(errors, rank);
  return FileError{worst.max, worst.at_rank, sum / static_cast<double>(errors.size())};
}

absl::StatusOr<GainMapError> error_of_gain_map(const std::string& path, const Image& codes,
                                               const GainMapCodes& written) {
  ASSIGN_OR_RETURN(const Image hdr, read_image(path, default_image_limits()));
  const GainMapMetadata& metadata = written.metadata;
  const size_t channels = metadata.one_channel ? 1 : 3;
  const size_t pixels = size_t{hdr.width} * hdr.height;
  if (hdr.light != PictureLight::kHdr || written.codes.size() != channels * pixels) {
    return absl::InternalError(absl::StrFormat("%s: it was written with a gain map and read without", path));
  }
  const auto* const light = reinterpret_cast<const float*>(hdr.pixels.data());
  const auto* const code = reinterpret_cast<const float*>(codes.pixels.data());
  std::vector<float> errors;
  errors.reserve(3 * pixels);
  for (size_t i = 0; i < pixels; ++i) {
    for (size_t c = 0; c < 3; ++c) {
      const size_t k = channels == 1 ? 0 : c;
      const double sdr = to_linear(ColorCurve::kSrgb, code[4 * i + c]) + metadata.offset_sdr[k];
      const double shown = light[4 * i + c] + metadata.offset_hdr[k];
      if (sdr <= 0 || shown <= 0) continue;  // black, which has any gain
      const double gain = metadata.min_log2[k] + (metadata.max_log2[k] - metadata.min_log2[k]) *
                                                     written.codes[channels * i + k] / 255;
      errors.push_back(static_cast<float>(std::abs(log2_of(shown / sdr) - gain)));
    }
  }
  if (errors.empty()) return GainMapError{};
  const Worst worst = worst_of(errors, (errors.size() - 1) * 99 / 100);
  return GainMapError{worst.max, worst.at_rank};
}

namespace {

// A step between two codes where they are farthest apart, in 1/255 of the display range: of RGBA16F that of
// halves from 0.5 to 1.
double step_of(v1::OutputFormat format) {
  switch (format) {
    case v1::OUTPUT_FORMAT_RGBA16:
      return 255.0 / 65535;
    case v1::OUTPUT_FORMAT_RGBA16F:
      return 255.0 / 2048;
    default:
      return 1.0;
  }
}

}  // namespace

std::optional<ErrorParts> error_parts(const v1::ResultHeader& header, const v1::Settings& settings) {
  if (!header.has_verify() && !header.has_error_bound_codes()) return std::nullopt;
  const double step = step_of(header.format());
  const bool dithers = settings.dither() && header.format() != v1::OUTPUT_FORMAT_RGBA16F;
  return ErrorParts{.rendering = header.has_verify() ? header.verify_unrounded().max_error_codes()
                                                     : header.error_bound_codes(),
                    .proven = !header.has_verify(),
                    .dither = dithers ? step : 0.0,
                    .rounding = step / 2};
}

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
