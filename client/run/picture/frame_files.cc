#include "client/run/picture/frame_files.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

#include "absl/strings/str_format.h"
#include "client/base/failure.h"
#include "client/base/usage.h"
#include "client/run/server/embedded_server.h"

namespace candela {
namespace {

ImageFormat image_format(v1::OutputFormat format) {
  return format == v1::OUTPUT_FORMAT_RGBA16F  ? ImageFormat::kRgba16f
         : format == v1::OUTPUT_FORMAT_RGBA16 ? ImageFormat::kRgba16
                                              : ImageFormat::kRgba8;
}

// Whether any field has a value. A message within counts only if one of its own fields has one.
bool sets_a_field(const google::protobuf::Message& message) {
  std::vector<const google::protobuf::FieldDescriptor*> set;
  const google::protobuf::Reflection& reflection = *message.GetReflection();
  reflection.ListFields(message, &set);
  return std::ranges::any_of(set, [&](const google::protobuf::FieldDescriptor* field) {
    return field->cpp_type() != google::protobuf::FieldDescriptor::CPPTYPE_MESSAGE ||
           sets_a_field(reflection.GetMessage(message, field));
  });
}

}  // namespace

bool has_primaries(const v1::Settings& settings) {
  return settings.has_input_chromaticities() || settings.input_primaries() != v1::PRIMARIES_UNSPECIFIED;
}

v1::Chromaticities to_message(const std::array<float, 8>& xy) {
  v1::Chromaticities c;
  c.set_red_x(xy[0]);
  c.set_red_y(xy[1]);
  c.set_green_x(xy[2]);
  c.set_green_y(xy[3]);
  c.set_blue_x(xy[4]);
  c.set_blue_y(xy[5]);
  c.set_white_x(xy[6]);
  c.set_white_y(xy[7]);
  return c;
}

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

void show_display_light(const Image& image, v1::Settings& settings) {
  if (!image.display_light) return;
  if (!sets_a_field(settings.exposure())) settings.mutable_exposure()->set_mode(v1::Exposure::MODE_MANUAL);
  if (!sets_a_field(settings.bloom())) settings.mutable_bloom()->set_intensity(0);
}

Image picture_of(RenderResult result, bool has_alpha, double pixel_aspect) {
  Image picture;
  picture.width = result.header.width();
  picture.height = result.header.height();
  picture.format = image_format(result.header.format());
  picture.pixels = PixelBuffer(std::move(result.data), result.bytes);
  picture.has_alpha = has_alpha;
  picture.pixel_aspect = pixel_aspect;
  return picture;
}

WriteOptions write_options_for(WriteOptions options, const v1::ResultHeader& result) {
  options.hdr.max_light_nits = result.max_light_nits();
  options.hdr.mean_light_nits = result.mean_light_nits();
  options.gain_map_max_log2 = result.gain_map_max_log2();
  return options;
}

absl::Status name_file(const absl::Status& status, const std::string& path) {
  if (absl::IsUnavailable(status) || absl::IsDeadlineExceeded(status)) return about_input(status, path);
  return about_input(reworded(status, absl::StrFormat("%s: %s", path, status.message())), path);
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
