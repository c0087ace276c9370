#include "client/cli/files/sequence/frame_files.h"

#include <array>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <utility>

#include "absl/strings/str_format.h"
#include "client/base/failure.h"
#include "client/cli/commands/embedded_server.h"
#include "client/cli/options/picture/settings_options.h"
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
  ImageLimits limits = default_image_limits();
  limits.max_dimension = server.max_dimension();
  limits.max_bytes = server.max_frame_bytes();
  limits.max_pixels = options.max_pixels;
  if (options.max_chunk_mib > 0) limits.max_chunk_bytes = options.max_chunk_mib << 20;
  return limits;
}

ImageLimits default_image_limits() { return {.max_chunk_bytes = EmbeddedServer::usable_memory_bytes() / 8}; }

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

std::string cube_map_note(const Image& image) {
  if (!image.is_cube_map) return "";
  return "the file is a cube map (envmap): its faces are rendered as they lie in it; candela view and "
         "candela environment show what they surround";
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

absl::StatusOr<BakedView> bake(const PictureOptions& options) {
  const ViewChoice& choice = options.view;
  absl::StatusOr<ViewTable> baked = bake_view(choice);
  if (!baked.ok()) {
    const bool is_image = describe_image(choice.config, default_image_limits()).ok();
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
  view.report = {baked->display,   baked->view,       baked->input,      table.size,    table.end,
                 baked->max_codes, baked->p999_codes, baked->mean_codes, choice.config, choice.source};
  view.notes = std::exchange(baked->notes, {});
  if (baked->as_is && has_primaries(options.settings)) {
    view.notes.push_back("--primaries changes nothing: the view shows the file's own values");
  }
  baked->table = {};
  view.view = *std::move(baked);
  return view;
}

void show_by(const BakedView& view, v1::Settings& settings) {
  if (!view.view.as_is) {
    *settings.mutable_table() = view.table;
    return;
  }
  settings.set_curve(v1::TONE_CURVE_LINEAR);
  settings.set_transfer(v1::TRANSFER_LINEAR);
  settings.clear_input_primaries();
  settings.clear_input_chromaticities();
}

PictureChoice choice_of(const PictureOptions& options, const BakedView* view) {
  PictureChoice choice = options.shown;
  choice.own_values =
      has_primaries(options.settings) || !options.view.input.empty() || (view != nullptr && view->view.as_is);
  choice.as_floats = view != nullptr && view->view.to_scene;
  return choice;
}

void enter_scene(const BakedView* view, Image& image) {
  if (view == nullptr || !view->view.to_scene) return;
  std::vector<float> rgb(size_t{3} * image.width);
  for (uint32_t y = 0; y < image.height; ++y) {
    std::byte* const row = image.pixels.data() + y * image.row_bytes();
    const auto each = [&](auto change) {
      for (size_t x = 0; x < image.width; ++x) {
        std::array<float, 4> pixel;
        std::memcpy(pixel.data(), row + x * sizeof pixel, sizeof pixel);
        const float alpha = pixel[3] > 0 && std::isfinite(pixel[3]) ? pixel[3] : 1.0f;
        for (size_t c = 0; c < 3; ++c) change(pixel[c], rgb[3 * x + c], alpha);
        std::memcpy(row + x * sizeof pixel, pixel.data(), sizeof pixel);
      }
    };
    each([](float component, float& value, float alpha) { value = component / alpha; });
    view->view.to_scene(rgb);
    each([](float& component, float value, float alpha) { component = value * alpha; });
  }
}

PrimariesUsed primaries_of(const Image& image, const v1::Settings& given, const BakedView* view) {
  PrimariesUsed used = primaries_used(image, given);
  if (view != nullptr && view->view.as_is) used.source = PrimariesUsed::Source::kValues;
  if (view != nullptr && !view->view.as_is && view->view.show_input) {
    used.source = PrimariesUsed::Source::kView;
    used.space = view->view.input;
  }
  return used;
}

}  // namespace candela
