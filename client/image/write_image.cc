#include <algorithm>
#include <cmath>
#include <filesystem>

#include "absl/strings/ascii.h"
#include "absl/strings/str_format.h"
#include "client/base/failure.h"
#include "client/image/write/writers.h"

namespace candela {
namespace {

absl::Status check_image(const std::string& path, const Image& image) {
  if (image.width == 0 || image.height == 0 || image.pixels.size() != image.bytes()) {
    return absl::InvalidArgumentError(absl::StrFormat("%s: a %dx%d %s image has %d bytes, this one has %d",
                                                      path, image.width, image.height, name(image.format),
                                                      image.bytes(), image.pixels.size()));
  }
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<OutputKind> output_kind(const std::string& path) {
  const std::string extension = absl::AsciiStrToLower(std::filesystem::path(path).extension().string());
  if (extension == ".png") return OutputKind::kPng;
  if (extension == ".jpg" || extension == ".jpeg") return OutputKind::kJpeg;
  if (extension == ".exr") return OutputKind::kExr;
  if (extension == ".pfm") return OutputKind::kPfm;
  return absl::InvalidArgumentError(absl::StrFormat(
      "%s: images are not written as '%s'; use .png, .jpg, .jpeg, .exr or .pfm", path, extension));
}

absl::StatusOr<OutputKind> check_output_path(const std::string& path) {
  absl::StatusOr<OutputKind> kind = output_kind(path);
  if (!kind.ok()) return kind;
  if (const auto target = writable_destination(path); !target.ok()) return target.status();
  return kind;
}

AspectRatio aspect_ratio(double pixel_aspect) {
  // Exact for ratios such as 3:2; with denominators up to 1000 others are within 0.05 %.
  for (int height = 1; height <= 1000; ++height) {
    const double width = pixel_aspect * height;
    if (width < 0.5 || width > 65535) continue;
    if (height == 1000 || std::fabs(width - std::round(width)) < 1e-5 * width) {
      return {static_cast<uint16_t>(std::round(width)), static_cast<uint16_t>(height)};
    }
  }
  return {};
}

PictureView picture_of(const Image& image) {
  const AspectRatio aspect = aspect_ratio(image.pixel_aspect);
  return {.width = image.width,
          .height = image.height,
          .wide = image.format == ImageFormat::kRgba16,
          .rows = image.pixels.data(),
          .row_stride_bytes = image.row_bytes(),
          .aspect_width = aspect.width,
          .aspect_height = aspect.height};
}

absl::StatusOr<std::vector<std::string>> write_image(const std::string& path, const Image& image,
                                                     const WriteOptions& options) {
  absl::StatusOr<OutputKind> kind = check_output_path(path);
  if (!kind.ok()) return kind.status();
  if (absl::Status status = check_image(path, image); !status.ok()) return status;
  absl::StatusOr<AtomicFile> file = AtomicFile::create(path);
  if (!file.ok()) return file.status();
  const auto write = *kind == OutputKind::kPng    ? write_png
                     : *kind == OutputKind::kJpeg ? write_jpeg
                     : *kind == OutputKind::kExr  ? write_exr
                                                  : write_pfm;
  Notes notes;
  absl::Status status = write(*file, image, options, notes);
  if (status.ok()) status = file->commit();
  if (!status.ok()) return failure_of(FailureKind::kOutput, status);
  return notes;
}

}  // namespace candela
