#include "client/cli/files/frame_files.h"

#include <cstring>
#include <utility>

#include "absl/strings/str_format.h"
#include "client/base/failure.h"
#include "client/cli/options/settings_options.h"
#include "client/cli/options/usage.h"
#include "client/image/describe.h"

namespace candela {
namespace {

ImageFormat image_format(v1::OutputFormat format) {
  return format == v1::OUTPUT_FORMAT_RGBA16F  ? ImageFormat::kRgba16f
         : format == v1::OUTPUT_FORMAT_RGBA16 ? ImageFormat::kRgba16
                                              : ImageFormat::kRgba8;
}

bool has_primaries(const v1::Settings& settings) {
  return settings.has_input_chromaticities() || settings.input_primaries() != v1::PRIMARIES_UNSPECIFIED;
}

}  // namespace

v1::PixelFormat wire_format(ImageFormat format) {
  return format == ImageFormat::kRgba16f ? v1::PIXEL_FORMAT_RGBA16F : v1::PIXEL_FORMAT_RGBA32F;
}

ImageLimits image_limits(const v1::Limits& server, const PictureOptions& options) {
  return {.max_dimension = server.max_dimension(),
          .max_bytes = server.max_frame_bytes(),
          .max_pixels = options.max_pixels};
}

FrameView view_of(const Image& image) {
  return {.width = image.width,
          .height = image.height,
          .format = wire_format(image.format),
          .pixels = image.pixels.span()};
}

v1::Settings settings_for(const Image& image, v1::Settings settings) {
  if (image.chromaticities && !has_primaries(settings))
    *settings.mutable_input_chromaticities() = to_message(*image.chromaticities);
  return settings;
}

absl::Status check_view_input(const Image& image, const std::string& path, const v1::Settings& settings,
                              const ViewChoice& view) {
  if (view.input.empty() || !image.chromaticities || has_primaries(settings)) return absl::OkStatus();
  return usage_error(
      absl::StrFormat("%s: its chromaticities convert it to Rec.709, and --ocio-input %s would convert it "
                      "once more; leave out "
                      "--ocio-input, or add --primaries rec709 to give the view the file's own values",
                      path, view.input));
}

absl::StatusOr<Image> picture_of(const RenderResult& result, bool has_alpha, double pixel_aspect) {
  const v1::ResultHeader& header = result.header;
  absl::StatusOr<Image> picture = make_image(header.width(), header.height(), image_format(header.format()));
  if (!picture.ok()) return picture;
  std::memcpy(picture->pixels.data(), result.data.get(), result.bytes);
  picture->has_alpha = has_alpha;
  picture->pixel_aspect = pixel_aspect;
  return picture;
}

absl::Status name_file(const absl::Status& status, const std::string& path) {
  if (absl::IsUnavailable(status) || absl::IsDeadlineExceeded(status)) return about_input(status, path);
  return about_input(reworded(status, absl::StrFormat("%s: %s", path, status.message())), path);
}

absl::StatusOr<BakedView> bake(const ViewChoice& choice) {
  absl::StatusOr<ViewTable> baked = bake_view(choice);
  if (!baked.ok()) {
    const bool is_image = describe_image(choice.config).ok();
    return input_failure(
        is_image ? absl::InvalidArgumentError(absl::StrFormat(
                       "%s: OpenColorIO cannot use it: it is an image; --ocio takes a configuration, such as "
                       "config.ocio",
                       choice.config))
                 : baked.status(),
        choice.config);
  }
  const ColorTable& table = baked->table;
  BakedView view;
  view.table.set_size(table.size);
  view.table.set_axes(static_cast<v1::ColorTable::Axes>(table.axes));
  view.table.set_end(table.end);
  view.table.set_values(table.values.data(), table.values.size() * sizeof table.values[0]);
  view.report = {baked->display, baked->view,      baked->input,      table.size,
                 table.end,      baked->max_codes, baked->p999_codes, baked->mean_codes};
  view.notes = std::move(baked->notes);
  view.show = std::move(baked->show);
  return view;
}

}  // namespace candela
