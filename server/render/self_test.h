// One frame against the reference before a server says that it serves.
#pragma once

#include "absl/status/status.h"
#include "server/render/renderer.h"

namespace candela {

// With settings by default, what most frames are: they find their pipelines made.
inline constexpr PixelFormat kUsualFormat = PixelFormat::kRgba16f;

// INTERNAL naming what is off and by how much, when the device or its driver computes something else than the
// reference does; the renderer's own error when it cannot render at all. Takes some milliseconds once
// pipelines are compiled.
absl::Status self_test(Renderer& renderer);

// The judgement alone: INTERNAL where the rendered image in `memory`, or its statistics, are not within the
// bounds of docs/pipeline.md section 6, and half a code of rounding, of what the reference makes of the wire
// pixels in it. As verify_frame.
absl::Status hold_to_reference(FrameMemory& memory, const Settings& settings, const FrameReport& report);

}  // namespace candela
