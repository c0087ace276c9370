// JPEG (JFIF), 8 bit, with colour at full resolution (4:4:4): lamps on a dark ground smear otherwise.
// jpeglib.h wants FILE and size_t declared before it.
#include <cstdio>

// clang-format off
#include <jpeglib.h>
// clang-format on

#include <csetjmp>
#include <cstdlib>

#include "absl/strings/str_format.h"
#include "client/image/writers.h"

namespace candela {
namespace {

struct Failure {
  jpeg_error_mgr manager;  // first, so that libjpeg's pointer to it is one to this
  std::jmp_buf leave;
  char text[JMSG_LENGTH_MAX] = "";
};

[[noreturn]] void on_error(j_common_ptr codec) {
  auto* failure = reinterpret_cast<Failure*>(codec->err);
  failure->manager.format_message(codec, failure->text);
  std::longjmp(failure->leave, 1);
}

void on_message(j_common_ptr) {}

struct Encoded {
  unsigned char* bytes = nullptr;  // from malloc
  unsigned long size = 0;
};

// Nothing in here has a destructor: libjpeg leaves it by longjmp. False on failure.
bool encode(jpeg_compress_struct& codec, Failure& failure, Encoded& out, const Image& image, int quality) {
  codec.err = jpeg_std_error(&failure.manager);
  failure.manager.error_exit = on_error;
  failure.manager.output_message = on_message;
  if (setjmp(failure.leave) != 0) return false;
  jpeg_create_compress(&codec);
  jpeg_mem_dest(&codec, &out.bytes, &out.size);
  codec.image_width = image.width;
  codec.image_height = image.height;
  codec.input_components = 4;
  codec.in_color_space = JCS_EXT_RGBX;  // libjpeg-turbo: the fourth component is skipped
  jpeg_set_defaults(&codec);
  jpeg_set_quality(&codec, quality, TRUE);
  for (int i = 0; i < codec.num_components; ++i) {
    codec.comp_info[i].h_samp_factor = codec.comp_info[i].v_samp_factor = 1;
  }
  // Dots per unit of no size: the wider a pixel, the fewer.
  const AspectRatio ratio = aspect_ratio(image.pixel_aspect);
  codec.density_unit = 0;
  codec.X_density = ratio.height;
  codec.Y_density = ratio.width;
  jpeg_start_compress(&codec, TRUE);
  for (uint32_t y = 0; y < image.height; ++y) {
    auto* row =
        reinterpret_cast<JSAMPROW>(const_cast<std::byte*>(image.pixels.data() + y * image.row_bytes()));
    jpeg_write_scanlines(&codec, &row, 1);
  }
  jpeg_finish_compress(&codec);
  return true;
}

}  // namespace

absl::Status write_jpeg(AtomicFile& file, const Image& image, const WriteOptions& options, Notes& notes) {
  if (image.format != ImageFormat::kRgba8) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: a JPEG is written from rgba8, not %s", file.path(), name(image.format)));
  }
  if (options.jpeg_quality < 1 || options.jpeg_quality > 100) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: JPEG quality %d is not within 1 .. 100", file.path(), options.jpeg_quality));
  }
  jpeg_compress_struct codec{};
  Failure failure;
  Encoded encoded;
  const bool whole = encode(codec, failure, encoded, image, options.jpeg_quality);
  jpeg_destroy_compress(&codec);
  if (!whole) {
    // After a failure libjpeg may have freed these bytes already (it grows them); the rare leak is the lesser
    // evil.
    return absl::InternalError(absl::StrFormat("%s: cannot encode the JPEG: %s", file.path(), failure.text));
  }
  file.write(encoded.bytes, encoded.size);  // commit() looks for failures
  std::free(encoded.bytes);
  if (image.has_alpha) notes.push_back("alpha dropped: .jpg has none");
  return absl::OkStatus();
}

}  // namespace candela
