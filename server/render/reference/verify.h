// Compares a rendered frame with the float64 reference.
#pragma once

#include <cstdint>

#include "server/render/frame/frame_memory.h"
#include "server/render/plan/plan.h"
#include "server/render/reference/verification.h"

namespace candela {

// Renders the wire pixels in `memory` again, in float64 and by the same plan, and compares what is in the
// memory with the result; fills the error map if the memory has one. `memory` has been rendered by `plan` and
// still holds everything; `stats` are the frame's. Codes are measured on the unquantised image if the memory
// was taken for verification. If not, they are measured on the finished image, include its rounding, and
// bloom is not compared. `bloom_level_size` may be a tier's own number, to compare its shaders with their
// twins. Any thread; uses every core.
FrameVerification verify_frame(FrameMemory& memory, const Plan& plan, const FrameStats& stats,
                               uint32_t bloom_level_size = kWholeBloom);

}  // namespace candela
