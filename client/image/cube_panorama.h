// Cube maps in OpenEXR files, as panoramas.
#pragma once

#include <cstdint>

#include "absl/status/statusor.h"
#include "client/image/image.h"

namespace candela {

// The equirectangular panorama that shows what the cube map shows: the six faces of OpenEXR, N x N pixels
// each, below one another. Its middle shows +Z, as OpenEXR's own projection has it (ImfEnvmap.h). It is 4 N
// pixels wide, or less within `most_width` and `max_bytes`, half as high, and has the cube's format. A pixel
// is the mean of 16 samples of the faces (4 if N is 1024 or more), bilinear between their pixels.
// INVALID_ARGUMENT if the picture is not six times as high as wide. RESOURCE_EXHAUSTED if there is not enough
// memory.
absl::StatusOr<Image> panorama_of_cube(const Image& cube, uint32_t most_width, uint64_t max_bytes);

}  // namespace candela
