// A frame held against the float64 reference.
#pragma once

#include <cstdint>

#include "server/render/renderer.h"

namespace candela {

// The tier's number that leaves nothing out.
inline constexpr uint32_t kWholeBloom = 2;

// What verify_frame allocates beside the frame's own memory: about 26 bytes a pixel.
uint64_t reference_bytes_of(const FrameDesc& desc, const Settings& settings);

// The mean log2 luminance, in EV, of the wire pixels in `memory`, metered in float64 from a scene that is not
// rounded to halves.
double reference_mean_log2_luminance(const FrameMemory& memory, const Settings& settings);

// Renders the finished image of `memory` from the wire pixels in it, in float64, from a scene that is not
// rounded to halves, at the exposure factor E. If the memory was allocated for verification, also renders the
// unquantised image. Uses every core.
void render_by_reference(FrameMemory& memory, const Settings& settings, const FrameMoment& moment,
                         double exposure);

// Renders the wire pixels in `memory` once more, in float64 and at the reported exposure, and holds what the
// device made of them against it; fills the error map where the memory has one. Codes are measured on the
// unquantised image where the memory was allocated for verification, else on the image itself, whose own
// rounding is then part of them, and the bloom is not looked at. `memory` has been rendered with `settings`
// at `moment` and still holds everything. `bloom_level_size` may be a tier's own number, to hold its shaders
// to their twins. Any thread; uses every core.
FrameVerification verify_frame(FrameMemory& memory, const Settings& settings, const FrameReport& report,
                               const FrameMoment& moment = {}, uint32_t bloom_level_size = kWholeBloom);

}  // namespace candela
