// The writers of the file kinds, for write_image(). Internal to client/image. Each writes the image to the
// file and adds messages for the user to `notes`. Errors name the file; INVALID_ARGUMENT means that it cannot
// write this format.
#pragma once

#include <string>
#include <vector>

#include "absl/status/status.h"
#include "client/image/image.h"
#include "client/image/write/atomic_file.h"
#include "server/encode/picture.h"

namespace candela {

using Notes = std::vector<std::string>;

absl::Status write_png(AtomicFile& file, const Image& image, const WriteOptions& options, Notes& notes);
absl::Status write_jpeg(AtomicFile& file, const Image& image, const WriteOptions& options, Notes& notes);
absl::Status write_exr(AtomicFile& file, const Image& image, const WriteOptions& options, Notes& notes);
absl::Status write_pfm(AtomicFile& file, const Image& image, const WriteOptions& options, Notes& notes);

// A pixel's width : height as the nearest fraction of 16-bit numbers.
struct AspectRatio {
  uint16_t width = 1;
  uint16_t height = 1;
};
AspectRatio aspect_ratio(double pixel_aspect);

// A view for the encoders of an image in kRgba8 or kRgba16.
PictureView picture_of(const Image& image);

}  // namespace candela
