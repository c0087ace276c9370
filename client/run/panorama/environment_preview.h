// A picture of all levels of a baked environment.
#pragma once

#include "absl/status/statusor.h"
#include "candela/v1/render.pb.h"
#include "client/environment/baked_environment.h"
#include "client/image/image.h"

namespace candela {

// The crosses of the levels side by side, as light. Faces larger than 256 texels are reduced to that: each
// pixel is the mean of the texels that it stands for. Fails like cross_picture().
absl::StatusOr<Image> environment_preview(const BakedEnvironment& environment);

// The default settings, but for what is between the crosses: it is not metered, and nothing shines on it.
v1::Settings preview_settings();

}  // namespace candela
