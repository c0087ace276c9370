// Writes JPEG (JFIF) with 8 bits, 4:4:4.
#include "absl/strings/str_format.h"
#include "client/image/write/encoded_aspect.h"
#include "client/image/write/writers.h"

namespace candela {

absl::Status write_jpeg(AtomicFile& file, const Image& image, const WriteOptions& options, Notes& notes) {
  if (image.format != ImageFormat::kRgba8) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: a JPEG is written from rgba8, not %s", file.path(), name(image.format)));
  }
  if (options.jpeg_quality < 1 || options.jpeg_quality > 100) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: JPEG quality %d is not within 1 .. 100", file.path(), options.jpeg_quality));
  }
  const absl::Status status =
      encode_jpeg(picture_of(image), {options.jpeg_quality, options.transfer},
                  [&file](const void* bytes, size_t count) { return file.write(bytes, count); });
  if (!status.ok() && !file.failed()) {
    return absl::InternalError(absl::StrFormat("%s: %s", file.path(), status.message()));
  }
  if (image.has_alpha) notes.push_back(kNoAlphaInJpeg);
  return absl::OkStatus();
}

}  // namespace candela
