// What write_image hands an image to once it knows the kind of the file. Internal to client/image. Each
// writes to the file, adds what the user should hear to `notes`, and fails naming the file; a format it
// cannot write is INVALID_ARGUMENT.
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

// Whether alpha would make a picture with colour in it wholly invisible: 0 everywhere, as some renderers
// leave it.
bool alpha_hides_everything(const Image& image);

// A pixel's width : height as a fraction of 16-bit numbers, as near as they come.
struct AspectRatio {
  uint16_t width = 1;
  uint16_t height = 1;
};
AspectRatio aspect_ratio(double pixel_aspect);

// An image of kRgba8 or kRgba16, for the encoders.
PictureView picture_of(const Image& image);

}  // namespace candela
