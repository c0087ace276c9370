#include "client/image/image.h"

#include <half.h>

#include <cmath>
#include <cstring>
#include <optional>
#include <utility>

#include "absl/strings/str_format.h"
#include "client/base/failure.h"
#include "client/image/color.h"
#include "client/image/describe.h"
#include "client/image/read/file_reader.h"
#include "client/image/read/readers.h"
#include "client/image/read/signal.h"
#include "server/base/status_macros.h"

namespace candela {

std::optional<FrameRate> film_rate(double frames_a_second) {
  constexpr double kRounding = 0.005;
  for (const uint64_t whole : {24, 30, 48, 60, 120}) {
    const FrameRate rate{whole * 1000, 1001};
    const double exact = static_cast<double>(rate.frames) / static_cast<double>(rate.seconds);
    if (std::fabs(frames_a_second - exact) <= kRounding) return rate;
  }
  return std::nullopt;
}

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

namespace {

absl::StatusOr<Image> image_in(PixelMemory (*memory)(size_t), uint32_t width, uint32_t height,
                               ImageFormat format) {
  Image image;
  image.width = width;
  image.height = height;
  image.format = format;
  image.pixels = PixelBuffer(memory(image.bytes()), image.bytes());
  if (image.pixels.size() != image.bytes() || image.pixels.empty()) {
    return failure_of(FailureKind::kOther,
                      absl::ResourceExhaustedError(absl::StrFormat(
                          "not enough memory for the %d bytes of a %dx%d image; give this process more, or "
                          "scale it down",
                          image.bytes(), width, height)));
  }
  return image;
}

}  // namespace

absl::StatusOr<Image> make_image(uint32_t width, uint32_t height, ImageFormat format) {
  return image_in(new_pixels, width, height, format);
}

absl::StatusOr<Image> image_to_overwrite(uint32_t width, uint32_t height, ImageFormat format) {
  return image_in(pixels_to_overwrite, width, height, format);
}

absl::StatusOr<Image> to_floats(Image image) {
  if (image.format != ImageFormat::kRgba16f) return image;
  absl::StatusOr<Image> floats = image_to_overwrite(image.width, image.height, ImageFormat::kRgba32f);
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

namespace {

const char* words_of(FileKind kind) {
  switch (kind) {
    case FileKind::kExr:
      return "OpenEXR";
    case FileKind::kRadiance:
      return "Radiance";
    case FileKind::kPfm:
      return "PFM";
    case FileKind::kPng:
      return "PNG";
    case FileKind::kAvif:
      return "AVIF";
    case FileKind::kJpeg:
      return "JPEG";
    case FileKind::kTiff:
      return "TIFF";
  }
  return "?";
}

// Reads a file of a kind that holds one picture: every kind but OpenEXR.
absl::StatusOr<Image> read_picture(FileKind kind, FileReader& file, const ImageLimits& limits,
                                   const PictureChoice& choice) {
  switch (kind) {
    case FileKind::kRadiance:
      return read_radiance(file, limits, choice.fills_gaps);
    case FileKind::kPng:
      return read_png(file, limits, choice);
    case FileKind::kAvif:
      return read_avif(file, limits, choice);
    case FileKind::kJpeg:
      return read_jpeg(file, limits, choice);
    case FileKind::kTiff:
      return read_tiff(file, limits, choice);
    default:
      return read_pfm(file, limits, choice);
  }
}

absl::StatusOr<Image> read_any_image(absl::StatusOr<FileReader> file, const ImageLimits& limits,
                                     const PictureChoice& choice) {
  if (!file.ok()) return file.status();
  ASSIGN_OR_RETURN(const FileKind kind, file_kind(*file));
  if (kind != FileKind::kExr && !choice.empty()) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: only OpenEXR files have parts, layers and views; this is a %s file with one picture",
        file->path(), words_of(kind)));
  }
  absl::StatusOr<Image> image =
      kind == FileKind::kExr ? read_exr(*file, limits, choice) : read_picture(kind, *file, limits, choice);
  if (!image.ok()) return image;
  if (choice.own_values) {
    image->chromaticities.reset();
    image->names_primaries = false;
  }
  const bool decodes = image->signal.empty() && decodes_values(choice);
  if (choice.as_floats || decodes) {
    RETURN_IF_ERROR(
        check_image_size(file->path(), "image", image->width, image->height, ImageFormat::kRgba32f, limits));
    image = to_floats(*std::move(image));
  }
  if (image.ok() && decodes) decode_values(choice, *image);
  return image;
}

absl::StatusOr<FileFacts> describe_any_image(absl::StatusOr<FileReader> file, const ImageLimits& limits) {
  if (!file.ok()) return file.status();
  ASSIGN_OR_RETURN(const FileKind kind, file_kind(*file));
  if (kind == FileKind::kExr) return describe_exr(*file, limits);

  ASSIGN_OR_RETURN(const Image image, read_picture(kind, *file, limits, {}));
  const WindowFacts window{0, 0, int64_t{image.width} - 1, int64_t{image.height} - 1};
  PartFacts part{.storage = image.signal.empty() ? "scan lines" : image.signal,
                 .display = window,
                 .data = window,
                 .pixel_aspect = image.pixel_aspect,
                 .chromaticities = image.chromaticities};
  if (image.names_primaries && !image.chromaticities) part.chromaticities = kRec709.xy;
  return FileFacts{.kind = words_of(kind),
                   .parts = {std::move(part)},
                   .renderable = absl::OkStatus(),
                   .shown = "the whole picture",
                   .notes = image.notes};
}

}  // namespace

absl::StatusOr<Image> read_image(const std::string& path, const ImageLimits& limits,
                                 const PictureChoice& choice) {
  absl::StatusOr<Image> image = read_any_image(FileReader::open(path), limits, choice);
  if (image.ok()) return image;
  return input_failure(image.status(), path);
}

absl::StatusOr<Image> read_image_bytes(const std::string& name, std::string bytes, const ImageLimits& limits,
                                       const PictureChoice& choice) {
  absl::StatusOr<Image> image = read_any_image(FileReader::of(name, std::move(bytes)), limits, choice);
  if (image.ok()) return image;
  return input_failure(image.status(), name);
}

absl::StatusOr<FileFacts> describe_image(const std::string& path, const ImageLimits& limits) {
  absl::StatusOr<FileFacts> facts = describe_any_image(FileReader::open(path), limits);
  if (facts.ok()) return facts;
  return input_failure(facts.status(), path);
}

absl::StatusOr<FileFacts> describe_image_bytes(const std::string& name, std::string bytes,
                                               const ImageLimits& limits) {
  absl::StatusOr<FileFacts> facts = describe_any_image(FileReader::of(name, std::move(bytes)), limits);
  if (facts.ok()) return facts;
  return input_failure(facts.status(), name);
}

}  // namespace candela
