// Renders one frame and compares it with the float64 reference, before the server reports that it serves.
#pragma once

#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "server/render/renderer.h"

namespace candela {

// Most frames are of this format and have default settings; the self-test compiles their pipelines.
inline constexpr v1::PixelFormat kUsualFormat = v1::PIXEL_FORMAT_RGBA16F;

// Returns a digest of what it rendered: of its image and its statistics by their bits, and of a table that
// OpenColorIO makes for aces-1. INTERNAL naming the error if the device or its driver computes something else
// than the reference does; the renderer's own error if it cannot render at all. Takes some milliseconds once
// the pipelines are compiled.
absl::StatusOr<std::string> self_test(Renderer& renderer);

// The comparison alone: INTERNAL if the rendered image in `memory`, or its statistics, are not within the
// bounds of docs/pipeline.md section 6, and half a code of rounding, of the float64 reference. Reads `memory`
// as verify_frame does.
absl::Status hold_to_reference(FrameMemory& memory, const FrameReport& report);

}  // namespace candela
