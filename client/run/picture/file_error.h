// The difference between a lossy file and the picture that it was made of.
#pragma once

#include <cstdint>
#include <string>

#include "absl/status/statusor.h"
#include "client/image/image.h"
#include "server/encode/gain_map.h"

namespace candela {

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

}  // namespace candela
