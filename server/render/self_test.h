// One frame against the reference before a server says that it serves.
#pragma once

#include <cstddef>
#include <span>

#include "absl/status/status.h"
#include "server/render/renderer.h"

namespace candela {

// INTERNAL naming what is off and by how much, when the device or its driver computes something else than the
// reference does; the renderer's own error when it cannot render at all. Takes some milliseconds once
// pipelines are compiled.
absl::Status self_test(Renderer& renderer);

// The judgement alone: INTERNAL where the image in `memory`, or its statistics, are not within the bounds of
// docs/pipeline.md section 6 of what the reference makes of `wire` (tight rows) at the reported exposure.
absl::Status hold_to_reference(const FrameMemory& memory, const FrameReport& report, const Settings& settings,
                               std::span<const std::byte> wire);

}  // namespace candela
