// Draws the error map of a verified frame as a picture.
#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "absl/status/statusor.h"
#include "client/image/image.h"

namespace candela {

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
