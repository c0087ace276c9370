#include "client/run/panorama/environment_preview.h"

#include <array>
#include <utility>
#include <vector>

#include "client/environment/cube_faces.h"
#include "client/environment/pictures.h"

namespace candela {
namespace {

constexpr uint32_t kLargestFace = 256;  // pixels
constexpr uint32_t kMargin = 16;        // pixels

constexpr double kLeastMetered = 1e-6;  // luminance

// The mean of the n x n opaque pixels from column x and row y on.
std::array<float, 3> mean(const Image& image, uint32_t x, uint32_t y, uint32_t n) {
  const CubeFormat format =
      image.format == ImageFormat::kRgba32f ? CubeFormat::kRgba32f : CubeFormat::kRgba16f;
  std::array<float, 3> sum{};
  for (uint32_t j = 0; j < n; ++j) {
    for (uint32_t i = 0; i < n; ++i) {
      const size_t at = (y + j) * image.row_bytes() + (x + i) * bytes_per_pixel(image.format);
      const std::array<float, 3> pixel = texel_rgb(image.pixels.data() + at, format);
      for (size_t c = 0; c < sum.size(); ++c) sum[c] += pixel[c];
    }
  }
  const float share = 1.0f / static_cast<float>(n * n);
  return {sum[0] * share, sum[1] * share, sum[2] * share};
}

absl::StatusOr<Image> reduced(const Image& image, uint32_t n) {
  absl::StatusOr<Image> small = make_image(image.width / n, image.height / n, image.format);
  if (!small.ok()) return small;
  std::byte* out = small->pixels.data();
  for (uint32_t y = 0; y < small->height; ++y) {
    for (uint32_t x = 0; x < small->width; ++x) {
      write_pixel(mean(image, x * n, y * n, n), image.format, out);
      out += bytes_per_pixel(image.format);
    }
  }
  return small;
}

}  // namespace

absl::StatusOr<Image> environment_preview(const BakedEnvironment& environment) {
  std::vector<Image> crosses;
  for (size_t level = 0; level < environment.levels.size(); ++level) {
    absl::StatusOr<Image> cross = cross_picture(environment, level);
    const uint32_t size = environment.levels[level].size;
    if (cross.ok() && size > kLargestFace) cross = reduced(*cross, size / kLargestFace);
    if (!cross.ok()) return cross;
    crosses.push_back(*std::move(cross));
  }
  return preview_sheet(crosses, kMargin);
}

v1::Settings preview_settings() {
  v1::Settings settings;
  settings.mutable_exposure()->mutable_metering()->set_ignore_below(kLeastMetered);
  settings.mutable_bloom()->set_intensity(0);
  return settings;
}

}  // namespace candela
