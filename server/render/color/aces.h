// The full ACES 1.x output transform for SDR video and an sRGB display (RRT, then the 100-nit ODT with D65
// white), as OpenColorIO's CPU code computes it: the truth of the curve `aces-1`.
#pragma once

#include <cstdint>
#include <memory>
#include <span>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "shaders/color_table.h"

namespace candela {

// R, G, B after R, G, B, in place: exposed scene light (Rec.709, linear) to display-linear light (Rec.709),
// not clamped to [0, 1]. FAILED_PRECONDITION for an OpenColorIO without the transform. About 0.4 us a colour.
// Any thread.
absl::Status aces_1(std::span<float> rgb);

// The same as a table of size^3 points, baked when a size is first asked for and kept as long as the process
// lives. Fails as aces_1. Any thread.
absl::StatusOr<std::shared_ptr<const ColorTable>> aces_1_table(uint32_t size);

}  // namespace candela
