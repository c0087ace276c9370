// What is wrong with a picture, measured: in its file, in sum, and pixel by pixel.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>

#include "absl/status/statusor.h"
#include "candela/v1/render.pb.h"
#include "client/image/image.h"
#include "server/encode/gain_map.h"

namespace candela {

// The difference between a lossy file and the picture that it was made of.

// Reads the codes of a file that was written, as numbers of 0 .. 1. Fails as read_image() does.
absl::StatusOr<Image> read_codes(const std::string& path);

// Errors over R, G and B of the pixels that are not wholly transparent, in 1/255 of the display's range.
struct FileError {
  double max_codes = 0.0;
  double p999_codes = 0.0;
  double mean_codes = 0.0;
};

// Compares the codes of the file at `path` with `picture`, which is of integers. INTERNAL if they have not
// one size.
absl::StatusOr<FileError> error_of_file(const std::string& path, const Image& codes, const Image& picture);

// Errors of a gain map over all components, in stops.
struct GainMapError {
  double max_stops = 0.0;
  double p99_stops = 0.0;
};

// Reads the file again, as HDR, and compares its gains with those that were written. `codes` are those of its
// base. The rounding to the map's codes is not in the error: it is at most half a code, (max_log2 - min_log2)
// / 510. Fails as read_image() does.
absl::StatusOr<GainMapError> error_of_gain_map(const std::string& path, const Image& codes,
                                               const GainMapCodes& written);

// The error of an image, part by part (docs/pipeline.md section 6).

// The largest error that each part can add, in 1/255 of the display range.
struct ErrorParts {
  double rendering = 0.0;         // of the tier, before dither and rounding
  bool proven = false;            // `rendering` is the frame's bound, else it was measured in this frame
  std::optional<double> table{};  // of a view: its table, as it was measured when it was made
  double dither = 0.0;
  double rounding = 0.0;         // to the image's codes
  std::optional<double> file{};  // of a JPEG or AVIF file, measured by reading it again
  bool lacks_file = false;       // it is on standard output, which cannot be read again

  // The sum of the known parts.
  double sum() const { return rendering + table.value_or(0) + dither + rounding + file.value_or(0); }
};

// Those of a result without `table` and `file`. Absent if the result was neither verified nor rendered with
// max_error_codes. If both, the measured error counts.
std::optional<ErrorParts> error_parts(const v1::ResultHeader& header, const v1::Settings& settings);

// Draws the error map of a verified frame as a picture.

// The ends of the colour scale in codes. The scale is logarithmic from black to pale yellow, and the same for
// every map, so that maps can be compared.
inline constexpr double kLeastErrorCodes = 1e-5;
inline constexpr double kMostErrorCodes = 10.0;

// Describes the scale in words.
std::string error_scale_words();

// Draws `halves`, width x height errors in codes, one pixel each, with a legend below. A map that is narrower
// than the legend is padded on the right. Returns a kRgba8 image.
absl::StatusOr<Image> draw_error_map(std::span<const uint16_t> halves, uint32_t width, uint32_t height);

// Draws it into a .png that says what its colours mean.
absl::Status write_error_map(const std::string& path, std::span<const uint16_t> halves, uint32_t width,
                             uint32_t height);

}  // namespace candela
