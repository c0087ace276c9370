// A test scene as an image.
#pragma once

#include <cstdint>

#include "absl/status/statusor.h"
#include "client/image/image.h"
#include "client/image/scenes.h"

namespace candela {

// The scene as halves. Fails like make_image().
absl::StatusOr<Image> scene_image(uint32_t width, uint32_t height, const scenes::TexelFunction& texel);

}  // namespace candela
