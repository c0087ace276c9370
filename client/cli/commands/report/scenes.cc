#include "client/cli/commands/report/scenes.h"

#include <half.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <functional>
#include <limits>
#include <vector>

#include "client/image/sample.h"
#include "client/run/picture_error.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

constexpr float kMax = 65504.0f;  // the largest half
constexpr uint32_t kCaseWidth = 96;
constexpr uint32_t kCaseHeight = 64;
constexpr uint32_t kChartWidth = 256;

using scenes::everywhere;
using scenes::grey;
using scenes::noise;
using scenes::Texel;
using scenes::TexelFunction;

void put(Image& halves, uint32_t x, uint32_t y, const Texel& texel) {
  std::array<uint16_t, 4> bits;
  for (size_t k = 0; k < 4; ++k) bits[k] = imath_float_to_half(texel[k]);
  std::memcpy(halves.pixels.data() + y * halves.row_bytes() + size_t{x} * sizeof bits, bits.data(),
              sizeof bits);
}

Texel ramp(uint32_t x, uint32_t y) {
  return {0.01f * static_cast<float>(x % 97 + 1), 0.5f, 0.02f * static_cast<float>(y % 53 + 1), 1.0f};
}

// A full hue of largest component 1 and smallest 0.
Texel hue(float turn) {
  const auto part = [turn](float shift) {
    const float t = 6 * (turn + shift - std::floor(turn + shift));
    return std::clamp(std::abs(t - 3) - 1, 0.0f, 1.0f);
  };
  return {part(0), part(2.0f / 3), part(1.0f / 3), 1.0f};
}

struct CaseShape {
  std::string name, expected;
  uint32_t width, height;
  TexelFunction texel;
  std::optional<v1::ExposureState> previous = std::nullopt;
};

v1::ExposureState state(double exposure, double elapsed_seconds) {
  v1::ExposureState previous;
  previous.set_exposure(exposure);
  previous.set_elapsed_seconds(elapsed_seconds);
  return previous;
}

std::vector<CaseShape> case_shapes() {
  constexpr uint32_t kW = kCaseWidth, kH = kCaseHeight;
  std::vector<CaseShape> shapes;
  for (scenes::HardCase& hard : scenes::hard_cases(kW, kH)) {
    shapes.push_back({std::move(hard.name), std::move(hard.expected), kW, kH, std::move(hard.texel)});
  }
  const CaseShape others[] = {
      {"1x1", "metered whole, no bloom beyond level 0", 1, 1, ramp},
      {"1x7", "metered whole, edges clamped", 1, 7, ramp},
      {"16384x1", "metered whole, edges clamped", 16384, 1, ramp},
      {"3x5", "metered whole, edges clamped", 3, 5, ramp},
      {"step from black to 65504 in 1/24 s", "exposure falls at its speed", kW, kH, everywhere(kMax),
       state(64, 1.0 / 24)},
      {"elapsed 0 s", "exposure does not change", kW, kH, ramp, state(64, 0)},
      {"elapsed 1e-9 s", "exposure barely changes", kW, kH, ramp, state(64, 1e-9)},
      {"elapsed 1e9 s", "exposure reaches its target", kW, kH, ramp, state(64, 1e9)},
  };
  shapes.insert(shapes.end(), std::begin(others), std::end(others));
  return shapes;
}

absl::StatusOr<Image> copy_of(const Image& halves) {
  absl::StatusOr<Image> image = make_image(halves.width, halves.height, halves.format);
  if (image.ok()) std::memcpy(image->pixels.data(), halves.pixels.data(), halves.bytes());
  return image;
}

}  // namespace

FrameSize frame_size(double megapixels) {
  constexpr FrameSize kScreens[] = {
      {0.25, 667, 375}, {1, 1333, 750}, {2, 1920, 1080}, {8, 3840, 2160}, {33, 7680, 4320}};
  for (const FrameSize& screen : kScreens) {
    if (screen.megapixels == megapixels) return screen;
  }
  const double height = std::max(1.0, std::round(std::sqrt(megapixels * 1e6 * 9 / 16)));
  return {megapixels, static_cast<uint32_t>(std::max(1.0, std::round(megapixels * 1e6 / height))),
          static_cast<uint32_t>(height)};
}

absl::StatusOr<Image> sample_frame(uint32_t width, uint32_t height, float most) {
  ASSIGN_OR_RETURN(const Image scene, sample_scene(width, height));
  absl::StatusOr<Image> frame = make_image(width, height, ImageFormat::kRgba16f);
  if (!frame.ok()) return frame;
  const std::byte* in = scene.pixels.data();
  std::byte* out = frame->pixels.data();
  for (uint64_t i = 0; i < uint64_t{width} * height * 4; ++i) {
    float value = 0;
    std::memcpy(&value, in + i * sizeof value, sizeof value);
    const bool alpha = i % 4 == 3;
    const uint16_t bits = imath_float_to_half(std::clamp(value, -kMax, alpha ? kMax : most));
    std::memcpy(out + i * sizeof bits, &bits, sizeof bits);
  }
  return frame;
}

absl::StatusOr<Image> with_one_nan(const Image& halves) {
  absl::StatusOr<Image> image = copy_of(halves);
  if (!image.ok()) return image;
  put(*image, halves.width / 2, halves.height / 2, grey(std::numeric_limits<float>::quiet_NaN()));
  return image;
}

absl::StatusOr<Image> with_few_lights(const Image& halves) {
  constexpr uint32_t kLights = 5;
  absl::StatusOr<Image> image = copy_of(halves);
  for (uint32_t i = 0; image.ok() && i < kLights; ++i) {
    put(*image, (2 * i + 1) * halves.width / (2 * kLights), (i % 2 + 1) * halves.height / 3, grey(30000));
  }
  return image;
}

absl::StatusOr<Image> cropped(Image image, double megapixels) {
  const double scale = std::sqrt(megapixels * 1e6 / (static_cast<double>(image.width) * image.height));
  if (scale >= 1) return image;
  const auto part = [scale](uint32_t n) {
    return static_cast<uint32_t>(std::clamp(n * scale, 1.0, static_cast<double>(n)));
  };
  absl::StatusOr<Image> middle = make_image(part(image.width), part(image.height), image.format);
  if (!middle.ok()) return middle;
  const uint64_t left = uint64_t{(image.width - middle->width) / 2} * bytes_per_pixel(image.format);
  const uint32_t top = (image.height - middle->height) / 2;
  for (uint32_t y = 0; y < middle->height; ++y) {
    std::memcpy(middle->pixels.data() + y * middle->row_bytes(),
                image.pixels.data() + (y + top) * image.row_bytes() + left, middle->row_bytes());
  }
  middle->chromaticities = image.chromaticities;
  return middle;
}

absl::StatusOr<std::vector<HardCase>> hard_cases() {
  std::vector<HardCase> cases;
  for (CaseShape& shape : case_shapes()) {
    ASSIGN_OR_RETURN(Image frame, scene_image(shape.width, shape.height, shape.texel));
    cases.push_back(
        {std::move(shape.name), std::move(shape.expected), std::move(frame), std::move(shape.previous)});
  }
  return cases;
}

absl::StatusOr<Image> every_half() {
  absl::StatusOr<Image> image = make_image(256, 256, ImageFormat::kRgba16f);
  if (!image.ok()) return image;
  for (uint32_t half = 0; half < 65536; ++half) {
    const auto bits = static_cast<uint16_t>(half);
    const std::array<uint16_t, 4> texel = {bits, bits, bits, 0x3c00};  // alpha 1
    std::memcpy(image->pixels.data() + size_t{half} * sizeof texel, texel.data(), sizeof texel);
  }
  return image;
}

absl::StatusOr<Image> moving_highlight(std::optional<int> eighths) {
  constexpr uint32_t kWidth = 192, kHeight = 128;
  constexpr float kGround = 0.01f, kLight = 500.0f, kWide = 1.5f;
  const float left = kWidth / 2 + static_cast<float>(eighths.value_or(0)) / 8;
  const float top = kHeight / 2;
  const auto covered = [](uint32_t pixel, float begin) {
    const float from = static_cast<float>(pixel);
    return std::max(0.0f, std::min(from + 1, begin + kWide) - std::max(from, begin));
  };
  return scene_image(kWidth, kHeight, [&](uint32_t x, uint32_t y) {
    return grey(kGround + (eighths ? kLight * covered(x, left) * covered(y, top) : 0.0f));
  });
}

absl::StatusOr<std::vector<Chart>> color_charts() {
  const struct {
    const char* name;
    uint32_t height;
    TexelFunction texel;
  } shapes[] = {
      {"greys, 2^-10 .. 2^6", 4,
       [](uint32_t x, uint32_t y) { return grey(std::exp2(static_cast<float>(x + 256 * y) / 64 - 10)); }},
      {"random colours, 2^-10 .. 2^6", 64,
       [](uint32_t x, uint32_t y) -> Texel {
         const uint32_t i = x + kChartWidth * y;
         const float light = std::exp2(16 * noise(i, 0, 0) - 10);
         return {light * noise(i, 0, 1), light * noise(i, 0, 2), light * noise(i, 0, 3), 1.0f};
       }},
      {"saturated colours, 2^-10 .. 2^6", 64,
       [](uint32_t x, uint32_t y) {
         Texel c = hue(static_cast<float>(x) / kChartWidth);
         for (size_t k = 0; k < 3; ++k) c[k] *= std::exp2(static_cast<float>(y) / 4 - 10);
         return c;
       }},
  };
  std::vector<Chart> charts;
  for (const auto& shape : shapes) {
    ASSIGN_OR_RETURN(Image frame, scene_image(kChartWidth, shape.height, shape.texel));
    charts.push_back({shape.name, std::move(frame)});
  }
  return charts;
}

namespace {

// The pixels of `from` that pixel `i` of `to` covers: [begin, end), never empty.
struct Range {
  uint32_t begin, end;
};
Range share(uint32_t i, uint32_t from, uint32_t to) {
  const auto at = [&](uint64_t n) { return static_cast<uint32_t>(n * from / to); };
  return {at(i), std::max(at(i) + 1, at(uint64_t{i} + 1))};
}

uint32_t small_width(uint32_t width) { return std::min(width, kPageWidth); }

uint32_t small_height(uint32_t width, uint32_t height) {
  return std::max<uint32_t>(1, static_cast<uint32_t>(uint64_t{height} * small_width(width) / width));
}

template <typename Visit>
void visit_share(Range xs, Range ys, const Visit& visit) {
  for (uint32_t y = ys.begin; y < ys.end; ++y) {
    for (uint32_t x = xs.begin; x < xs.end; ++x) visit(x, y);
  }
}

}  // namespace

absl::StatusOr<Image> small_picture(std::span<const std::byte> rgba8, uint32_t width, uint32_t height) {
  absl::StatusOr<Image> small =
      make_image(small_width(width), small_height(width, height), ImageFormat::kRgba8);
  if (!small.ok()) return small;
  std::byte* out = small->pixels.data();
  for (uint32_t y = 0; y < small->height; ++y) {
    for (uint32_t x = 0; x < small->width; ++x) {
      const Range xs = share(x, width, small->width), ys = share(y, height, small->height);
      std::array<uint32_t, 3> sum{};
      visit_share(xs, ys, [&](uint32_t i, uint32_t j) {
        const std::byte* texel = rgba8.data() + (size_t{j} * width + i) * 4;
        for (size_t k = 0; k < 3; ++k) sum[k] += std::to_integer<uint32_t>(texel[k]);
      });
      const uint32_t count = (xs.end - xs.begin) * (ys.end - ys.begin);
      for (size_t k = 0; k < 3; ++k) *out++ = static_cast<std::byte>((sum[k] + count / 2) / count);
      *out++ = std::byte{255};
    }
  }
  return small;
}

absl::StatusOr<Image> small_error_map(std::span<const uint16_t> halves, uint32_t width, uint32_t height) {
  const uint32_t wide = small_width(width), high = small_height(width, height);
  std::vector<uint16_t> worst;
  worst.reserve(size_t{wide} * high);
  for (uint32_t y = 0; y < high; ++y) {
    for (uint32_t x = 0; x < wide; ++x) {
      uint16_t most = 0;  // errors are not negative, so their halves are ordered as their bits are
      visit_share(share(x, width, wide), share(y, height, high),
                  [&](uint32_t i, uint32_t j) { most = std::max(most, halves[size_t{j} * width + i]); });
      worst.push_back(most);
    }
  }
  return draw_error_map(worst, wide, high);
}

}  // namespace candela
