#include "client/run/panorama/panorama_file.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_format.h"
#include "client/base/failure.h"
#include "client/image/cube_panorama.h"
#include "client/run/picture/frame_files.h"
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
  const v1::Settings settings = settings_for(image, given);
  if (settings.has_input_chromaticities()) {
    *start.mutable_input_chromaticities() = settings.input_chromaticities();
  }
  start.set_input_primaries(settings.input_primaries());
  start.set_bad_values(settings.bad_values());
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

}  // namespace candela
