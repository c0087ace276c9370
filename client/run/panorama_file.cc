#include "client/run/panorama_file.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <utility>
#include <vector>

#include "absl/strings/str_format.h"
#include "client/base/failure.h"
#include "client/environment/cube_faces.h"
#include "client/environment/pictures.h"
#include "client/image/cube_panorama.h"
#include "client/run/picture_frame.h"
#include "proto/candela/v1/limits.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

constexpr double kLeastAspect = 1.9, kMostAspect = 2.1;

v1::EnvironmentStart start_of(const Image& image, const v1::Settings& given) {
  v1::EnvironmentStart start;
  start.set_width(image.width);
  start.set_height(image.height);
  start.set_format(wire_format(image.format));
  if (given.has_input_chromaticities()) {
    *start.mutable_input_chromaticities() = given.input_chromaticities();
  } else if (image.chromaticities && !has_primaries(given)) {
    *start.mutable_input_chromaticities() = to_message(*image.chromaticities);
  }
  start.set_input_primaries(given.input_primaries());
  start.set_bad_values(given.bad_values());
  return start;
}

v1::Settings without_primaries(v1::Settings settings) {
  settings.clear_input_chromaticities();
  settings.clear_input_primaries();
  return settings;
}

absl::Status check_size(const Image& image, const std::string& path) {
  if (image.width <= v1::kMaxPanoramaWidth && image.height <= v1::kMaxPanoramaHeight) return absl::OkStatus();
  return input_failure(absl::ResourceExhaustedError(absl::StrFormat(
                           "%s: it is %dx%d pixels, and a panorama may have %dx%d; scale it down", path,
                           image.width, image.height, v1::kMaxPanoramaWidth, v1::kMaxPanoramaHeight)),
                       path);
}

}  // namespace

absl::StatusOr<PanoramaFile> read_panorama(const std::string& path, const PictureOptions& options,
                                           const v1::Limits& limits, const BakedView* view) {
  const ImageLimits most = image_limits(limits, options);
  absl::StatusOr<Image> read = read_image(path, most, choice_of(options, view));
  if (!read.ok()) return read.status();
  if (read->is_cube_map) {
    read = panorama_of_cube(*read, v1::kMaxPanoramaWidth, most.max_bytes);
    if (!read.ok()) return failure_of(FailureKind::kInput, name_file(read.status(), path));
  }
  RETURN_IF_ERROR(check_size(*read, path));
  enter_scene(view, *read);
  PanoramaFile file;
  file.notes = std::exchange(read->notes, {});
  file.missing_pixels = read->missing_pixels;
  if (!options.scene_light) file.light = read->light;
  file.peak = read->peak;
  RETURN_IF_ERROR(check_light_for_gain_map(path, file.light, options.settings.has_gain_map_peak_nits()));
  const double aspect = static_cast<double>(read->width) / read->height;
  if (aspect < kLeastAspect || aspect > kMostAspect) {
    file.notes.push_back(absl::StrFormat(
        "%s: it is %dx%d, but a panorama of the whole sphere is twice as wide as high; it is stretched over "
        "the sphere",
        path, read->width, read->height));
  }
  file.primaries = primaries_of(*read, options.settings, view);
  const bool as_is = view != nullptr && view->view.as_is;
  file.panorama =
      panorama_of(*std::move(read), as_is ? without_primaries(options.settings) : options.settings);
  return file;
}

std::shared_ptr<const Panorama> panorama_of(Image image, const v1::Settings& settings) {
  const auto kept = std::make_shared<const Image>(std::move(image));
  return std::make_shared<const Panorama>(Panorama{start_of(*kept, settings), kept->pixels.span(), kept});
}

v1::Settings without_panorama(v1::Settings settings) {
  settings = without_primaries(std::move(settings));
  settings.clear_bad_values();
  return settings;
}

absl::StatusOr<BakedEnvironment> environment_from(const EnvironmentBake& bake, Handedness handedness) {
  BakedEnvironment environment;
  environment.format = bake.format == v1::PIXEL_FORMAT_RGB9E5    ? CubeFormat::kRgb9e5
                       : bake.format == v1::PIXEL_FORMAT_RGBA32F ? CubeFormat::kRgba32f
                                                                 : CubeFormat::kRgba16f;
  environment.handedness = handedness;
  for (size_t i = 0; i < bake.levels.size(); ++i) {
    const v1::BakedLevel& level = bake.header.levels(static_cast<int>(i));
    PixelBuffer texels(bake.levels[i].size());
    if (texels.empty())
      return absl::ResourceExhaustedError(
          "out of memory for the cube map; give this process more memory (ulimit -v)");
    std::memcpy(texels.data(), bake.levels[i].data(), bake.levels[i].size());
    environment.levels.push_back({level.size(), static_cast<float>(level.roughness()), std::move(texels)});
  }
  const auto& sh = bake.header.radiance_sh();
  for (int i = 0; i < std::min(sh.size(), 27); ++i) {
    environment.harmonics[static_cast<size_t>(i / 3)][static_cast<size_t>(i % 3)] = static_cast<float>(sh[i]);
  }
  return environment;
}

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
