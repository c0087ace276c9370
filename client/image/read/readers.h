// What read_image hands a file to once it knows its kind. Internal to client/image; each obeys read_image's
// contract.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "client/image/image.h"
#include "client/image/read/file_reader.h"

namespace candela {

absl::StatusOr<Image> read_exr(FileReader& file, const ImageLimits& limits);
absl::StatusOr<Image> read_radiance(FileReader& file, const ImageLimits& limits);
absl::StatusOr<Image> read_pfm(FileReader& file, const ImageLimits& limits);

// `what` is the thing measured, in the user's words ("image", "data window"); `format` is what its
// pixels will be read to. Takes any numbers a header may hold.
absl::Status check_image_size(const std::string& path, const char* what, int64_t width, int64_t height,
                              ImageFormat format, const ImageLimits& limits);

// Text from a file for a message: its first `most` letters, all that is not printable ASCII as \xNN. A file
// might hold line ends or a terminal's commands there.
std::string printable(absl::string_view text, size_t most = 40);

// Puts primaries and white of a file into the image: left out when they are Rec.709 and D65 within 1e-4,
// ignored with a note when no matrix can be made of them (not finite, white of no luminance, primaries on a
// line).
void set_chromaticities(const std::array<float, 8>& xy, Image& image);

// A pixel's width over its height; ignored with a note when it is not finite or outside 0.01 .. 100.
void set_pixel_aspect(double aspect, Image& image);

}  // namespace candela
