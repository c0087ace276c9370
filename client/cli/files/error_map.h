// The error map of a verified frame as a picture.
#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "absl/status/statusor.h"
#include "client/image/image.h"

namespace candela {

// The colours' scale: logarithmic, from black at the least error to pale yellow at the most, in codes. The
// same for every map, so that maps can be compared.
inline constexpr double kLeastErrorCodes = 1e-5;
inline constexpr double kMostErrorCodes = 10.0;

// That in words.
std::string error_scale_words();

// Draws `halves`, rows of width x height errors in codes, pixel for pixel, with a legend strip below them
// (and blank to the right of maps that are narrower than the legend). kRgba8.
absl::StatusOr<Image> draw_error_map(std::span<const uint16_t> halves, uint32_t width, uint32_t height);

}  // namespace candela
