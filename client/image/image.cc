#include "client/image/image.h"

#include <half.h>

#include <cstring>
#include <utility>

#include "absl/strings/str_format.h"
#include "client/base/failure.h"
#include "client/image/read/file_reader.h"
#include "client/image/read/readers.h"
#include "server/base/status_macros.h"

namespace candela {

const char* name(ImageFormat format) {
  switch (format) {
    case ImageFormat::kRgba16f:
      return "rgba16f";
    case ImageFormat::kRgba32f:
      return "rgba32f";
    case ImageFormat::kRgba8:
      return "rgba8";
    case ImageFormat::kRgba16:
      return "rgba16";
  }
  return "?";
}

absl::StatusOr<Image> make_image(uint32_t width, uint32_t height, ImageFormat format) {
  Image image;
  image.width = width;
  image.height = height;
  image.format = format;
  image.pixels = PixelBuffer(image.bytes());
  if (image.pixels.size() != image.bytes() || image.pixels.empty()) {
    return failure_of(FailureKind::kOther,
                      absl::ResourceExhaustedError(absl::StrFormat(
                          "not enough memory for the %d bytes of a %dx%d image; give this process more, or "
                          "scale it down",
                          image.bytes(), width, height)));
  }
  return image;
}

absl::StatusOr<Image> to_floats(Image image) {
  if (image.format != ImageFormat::kRgba16f) return image;
  absl::StatusOr<Image> floats = make_image(image.width, image.height, ImageFormat::kRgba32f);
  if (!floats.ok()) return floats;
  const size_t components = image.bytes() / sizeof(uint16_t);
  for (size_t i = 0; i < components; ++i) {
    uint16_t bits;
    std::memcpy(&bits, image.pixels.data() + i * sizeof bits, sizeof bits);
    const float value = imath_half_to_float(bits);
    std::memcpy(floats->pixels.data() + i * sizeof value, &value, sizeof value);
  }
  image.format = ImageFormat::kRgba32f;
  image.pixels = std::move(floats->pixels);
  return image;
}

absl::Status check_image_size(const std::string& path, const char* what, int64_t width, int64_t height,
                              ImageFormat format, const ImageLimits& limits) {
  if (width < 1 || height < 1) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: the %s is %dx%d pixels; it must be at least 1x1", path, what, width, height));
  }
  if (width > limits.max_dimension || height > limits.max_dimension) {
    return absl::ResourceExhaustedError(
        absl::StrFormat("%s: the %s is %dx%d pixels; the limit is %d on a side, so crop it or scale it down",
                        path, what, width, height, limits.max_dimension));
  }
  if (limits.max_pixels > 0 &&
      static_cast<uint64_t>(width) * static_cast<uint64_t>(height) > limits.max_pixels) {
    return absl::ResourceExhaustedError(
        absl::StrFormat("%s: the %s is %dx%d, %d pixels; --max-pixels allows %d", path, what, width, height,
                        width * height, limits.max_pixels));
  }
  // Divides, because a product might overflow 64 bits.
  const uint32_t pixel_bytes = bytes_per_pixel(format);
  if (static_cast<uint64_t>(height) > limits.max_bytes / (static_cast<uint64_t>(width) * pixel_bytes)) {
    return absl::ResourceExhaustedError(absl::StrFormat(
        "%s: the %s is %dx%d pixels of %d bytes; the limit is %d bytes, so save it %s, or start a "
        "candelad with a larger --max-frame-bytes and name it with --server",
        path, what, width, height, pixel_bytes, limits.max_bytes,
        format == ImageFormat::kRgba32f ? "as half floats or smaller" : "smaller"));
  }
  return absl::OkStatus();
}

absl::StatusOr<FileKind> file_kind(FileReader& file) {
  ASSIGN_OR_RETURN(const std::string magic, file.peek(4));
  if (magic == "\x76\x2f\x31\x01") return FileKind::kExr;
  if (magic.starts_with("#?")) return FileKind::kRadiance;
  if (magic.starts_with("PF") || magic.starts_with("Pf")) return FileKind::kPfm;
  if (magic.empty()) return absl::InvalidArgumentError(absl::StrFormat("%s: the file is empty", file.path()));
  return absl::InvalidArgumentError(absl::StrFormat("%s: not an OpenEXR, Radiance or PFM file", file.path()));
}

namespace {

absl::StatusOr<Image> read_any_image(const std::string& path, const ImageLimits& limits,
                                     const PictureChoice& choice) {
  absl::StatusOr<FileReader> file = FileReader::open(path);
  if (!file.ok()) return file.status();
  ASSIGN_OR_RETURN(const FileKind kind, file_kind(*file));
  if (kind == FileKind::kExr) return read_exr(*file, limits, choice);
  if (!choice.empty()) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: only OpenEXR files have parts, layers and views; this is a %s file with one picture", path,
        kind == FileKind::kRadiance ? "Radiance" : "PFM"));
  }
  absl::StatusOr<Image> image = kind == FileKind::kRadiance ? read_radiance(*file, limits, choice.fills_gaps)
                                                            : read_pfm(*file, limits, choice.fills_gaps);
  if (image.ok() && choice.own_values) {
    image->chromaticities.reset();
    image->names_primaries = false;
  }
  return image;
}

}  // namespace

absl::StatusOr<Image> read_image(const std::string& path, const ImageLimits& limits,
                                 const PictureChoice& choice) {
  absl::StatusOr<Image> image = read_any_image(path, limits, choice);
  if (image.ok()) return image;
  return input_failure(image.status(), path);
}

}  // namespace candela
