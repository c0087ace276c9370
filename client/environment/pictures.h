// Pictures of a baked environment that people look at. write_image() stores them as OpenEXR.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "absl/status/statusor.h"
#include "client/environment/baked_environment.h"
#include "client/image/image.h"

namespace candela {

// The six faces of level `level` as a cross of 4N x 3N pixels, as one sees them from inside, unmirrored: from
// left to right left, ahead, right and behind; up above ahead, and down below it. The rest is black.
// In picture_format(), without alpha, whatever the environment's handedness. Fails like check_environment()
// and make_image(), and with OUT_OF_RANGE if there is no such level.
absl::StatusOr<Image> cross_picture(const BakedEnvironment& environment, size_t level);

// The level as a panorama of 4N x 2N pixels in the projection of docs/environments.md section 1, each pixel
// a seamless bilinear lookup at its centre. Otherwise like cross_picture().
absl::StatusOr<Image> equirectangular_picture(const BakedEnvironment& environment, size_t level);

// The pictures side by side from left to right, aligned at the top, with `margin` black pixels around each.
// They have one format, any of ImageFormat, which is the sheet's; pixels are copied as they are. So crosses
// may be tone-mapped before or after. INVALID_ARGUMENT if there is no picture or formats differ.
absl::StatusOr<Image> preview_sheet(std::span<const Image> pictures, uint32_t margin);

}  // namespace candela
