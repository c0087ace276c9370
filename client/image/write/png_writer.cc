// Writes PNG: 8 bits from kRgba8, 16 from kRgba16, with alpha if the image has it.
#include "absl/strings/str_format.h"
#include "client/image/write/writers.h"

namespace candela {

absl::Status write_png(AtomicFile& file, const Image& image, const WriteOptions& options, Notes&) {
  if (image.format != ImageFormat::kRgba8 && image.format != ImageFormat::kRgba16) {
    return absl::InvalidArgumentError(absl::StrFormat("%s: a PNG is written from rgba8 or rgba16, not %s",
                                                      file.path(), name(image.format)));
  }
  const PngOptions png{image.has_alpha, options.transfer, options.text};
  const absl::Status status = encode_png(
      picture_of(image), png, [&file](const void* bytes, size_t count) { return file.write(bytes, count); });
  if (status.ok() || file.failed()) return absl::OkStatus();  // commit() has the system's reason
  return absl::InternalError(absl::StrFormat("%s: %s", file.path(), status.message()));
}

}  // namespace candela
