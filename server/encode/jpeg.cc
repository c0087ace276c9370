// jpeglib.h needs FILE and size_t to be declared before it.
#include <cstdio>

// clang-format off
#include <jpeglib.h>
// clang-format on

#include <csetjmp>
#include <cstdlib>
#include <string>

#include "absl/strings/str_format.h"
#include "server/base/status_macros.h"
#include "server/encode/gain_map.h"
#include "server/encode/jpeg_codes.h"
#include "server/encode/picture.h"

namespace candela {
namespace {

struct JpegFailure {
  jpeg_error_mgr manager;  // first, so that libjpeg's pointer to it is also a pointer to JpegFailure
  std::jmp_buf leave;
  char text[JMSG_LENGTH_MAX] = "";
};

[[noreturn]] void on_error(j_common_ptr codec) {
  auto* failure = reinterpret_cast<JpegFailure*>(codec->err);
  failure->manager.format_message(codec, failure->text);
  std::longjmp(failure->leave, 1);
}

void on_message(j_common_ptr) {}

struct Encoded {
  unsigned char* bytes = nullptr;  // from malloc
  unsigned long size = 0;
};

// False on failure. It has no locals with destructors, because libjpeg leaves it by longjmp.
bool encode(jpeg_compress_struct& codec, JpegFailure& failure, Encoded& out, const JpegCodes& codes,
            int quality, const std::string& profile) {
  codec.err = jpeg_std_error(&failure.manager);
  failure.manager.error_exit = on_error;
  failure.manager.output_message = on_message;
  if (setjmp(failure.leave) != 0) return false;
  jpeg_create_compress(&codec);
  jpeg_mem_dest(&codec, &out.bytes, &out.size);
  codec.image_width = codes.width;
  codec.image_height = codes.height;
  codec.input_components = codes.pixel == JpegPixel::kGrey ? 1 : codes.pixel == JpegPixel::kRgb ? 3 : 4;
  codec.in_color_space = codes.pixel == JpegPixel::kGrey  ? JCS_GRAYSCALE
                         : codes.pixel == JpegPixel::kRgb ? JCS_RGB
                                                          : JCS_EXT_RGBX;  // only libjpeg-turbo has it
  jpeg_set_defaults(&codec);
  jpeg_set_quality(&codec, quality, TRUE);
  for (int i = 0; i < codec.num_components; ++i) {
    codec.comp_info[i].h_samp_factor = codec.comp_info[i].v_samp_factor = 1;
  }
  // Dots per unit, where the unit has no size. Wider pixels mean fewer dots.
  codec.density_unit = 0;
  codec.X_density = codes.aspect_height;
  codec.Y_density = codes.aspect_width;
  jpeg_start_compress(&codec, TRUE);
  if (!profile.empty()) {
    jpeg_write_icc_profile(&codec, reinterpret_cast<const JOCTET*>(profile.data()),
                           static_cast<unsigned>(profile.size()));
  }
  for (uint32_t y = 0; y < codes.height; ++y) {
    auto* row = reinterpret_cast<JSAMPROW>(const_cast<std::byte*>(codes.rows + y * codes.row_stride_bytes));
    jpeg_write_scanlines(&codec, &row, 1);
  }
  jpeg_finish_compress(&codec);
  return true;
}

}  // namespace

absl::Status encode_jpeg_codes(const JpegCodes& codes, int quality, const std::string& profile,
                               ByteSink sink) {
  jpeg_compress_struct codec{};
  JpegFailure failure;
  Encoded encoded;
  const bool whole = encode(codec, failure, encoded, codes, quality, profile);
  jpeg_destroy_compress(&codec);
  if (!whole) {
    // Do not free encoded.bytes: libjpeg may have freed them already while growing the buffer. A rare leak is
    // better than a double free.
    return absl::InternalError(absl::StrFormat("cannot encode the JPEG: %s", failure.text));
  }
  const bool taken = sink(encoded.bytes, encoded.size);
  std::free(encoded.bytes);
  return taken ? absl::OkStatus() : absl::InternalError("cannot encode the JPEG: write failed");
}

namespace {

// Of gain maps. Three channels span three times the stops of one.
constexpr int kGreyMapQuality = 95, kColourMapQuality = 98;

absl::Status encode_base(const PictureView& picture, const JpegOptions& options, ByteSink sink) {
  const JpegCodes codes{picture.width,        picture.height,           JpegPixel::kRgbx,
                        picture.rows,         picture.row_stride_bytes, picture.aspect_width,
                        picture.aspect_height};
  return encode_jpeg_codes(codes, options.quality, icc_profile(options.transfer), sink);
}

}  // namespace

absl::Status encode_jpeg(const PictureView& picture, const JpegOptions& options, ByteSink sink) {
  if (options.gain_map == nullptr) return encode_base(picture, options, sink);
  std::string base;
  RETURN_IF_ERROR(encode_base(picture, options, [&base](const void* bytes, size_t count) {
    base.append(static_cast<const char*>(bytes), count);
    return true;
  }));
  const GainMapCodes& gain_map = *options.gain_map;
  const bool one_channel = gain_map.metadata.one_channel;
  ASSIGN_OR_RETURN(const std::string map,
                   encode_gain_map(gain_map.codes, picture.width, picture.height, one_channel,
                                   one_channel ? kGreyMapQuality : kColourMapQuality));
  ASSIGN_OR_RETURN(const std::string file, join_gain_map(base, map, gain_map.metadata));
  return sink(file.data(), file.size()) ? absl::OkStatus()
                                        : absl::InternalError("cannot encode the JPEG: write failed");
}

}  // namespace candela
