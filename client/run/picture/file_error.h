// How far a file that loses detail is from the image that it was made of.
#pragma once

#include <cstdint>
#include <string>

#include "absl/status/statusor.h"
#include "client/image/image.h"

namespace candela {

// Errors over R, G and B of the pixels that are not wholly transparent, in 1/255 of the display's range.
struct FileError {
  double max_codes = 0.0;
  double p999_codes = 0.0;
  double mean_codes = 0.0;
};

// Reads the file again, as codes, and compares it with `picture`, which is of integers. Fails as read_image()
// does.
absl::StatusOr<FileError> error_of_file(const std::string& path, const Image& picture);

}  // namespace candela
