// The full ACES 1.x output transform for SDR video and an sRGB display (RRT, then the 100-nit ODT with D65
// white), as OpenColorIO's CPU code computes it. It defines the curve `aces-1`.
#pragma once

#include <cstdint>
#include <memory>
#include <span>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "shaders/color_table.h"

namespace candela {

// Converts exposed scene light (Rec.709, linear, outside of its gamut also negative) to display-linear light
// (Rec.709) in place: R, G, B, R, G, B ... The result is not clamped to [0, 1]. FAILED_PRECONDITION if this
// OpenColorIO does not have the transform. Takes about 0.4 us a colour. Any thread.
absl::Status aces_1(std::span<float> rgb);

// The same as a table of size^3 points. It is baked when its size is first requested, with checkpoints for
// threads that run in slices, and kept until the process ends. Fails as aces_1 does. Any thread.
absl::StatusOr<std::shared_ptr<const ColorTable>> aces_1_table(uint32_t size);

// The same for light up to the gamut of ACES AP1: on its axes, and up to more light. Takes 0.4 us a point,
// too.
absl::StatusOr<std::shared_ptr<const ColorTable>> aces_1_wide_table(uint32_t size);

}  // namespace candela
