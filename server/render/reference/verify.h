// Compares a rendered frame with the float64 reference.
#pragma once

#include <cstdint>

#include "server/render/frame/frame_memory.h"
#include "server/render/plan/frame_stats.h"
#include "server/render/plan/plan.h"

namespace candela {

// Errors over R, G and B. A code is 1/255 of the display range; codes are measured on the image before it is
// quantised. A NaN counts as an infinite error.
struct Verification {
  double max_codes = 0.0;
  double p999_codes = 0.0;
  double mean_codes = 0.0;
  uint32_t worst_x = 0;
  uint32_t worst_y = 0;
  uint64_t components = 0;
  uint64_t differing = 0;       // components whose quantised values differ; always 0 for RGBA16F
  double max_difference = 0.0;  // of quantised values, in steps of the output format
  double meter_error_ev = 0.0;  // of the mean log2 luminance
  double bloom_error = 0.0;     // of bloom level 0, relative to its largest value; 0 without bloom
};

struct FrameVerification {
  Verification rounded;    // against a reference that rounds the scene to halves, as the pipeline does
  Verification unrounded;  // against one that does not
  FrameStats truth;        // what the reference metered and counted; tile_light is not filled
  uint64_t gamut_cut_components = 0;  // by the reference, with the scene that `rounded` resolves
};

// Renders the wire pixels in `memory` again, in float64 and by the same plan, and compares what is in the
// memory with the result; fills the error map if the memory has one. `memory` has been rendered by `plan` and
// still holds everything; `stats` are the frame's. Codes are measured on the unquantised image if the memory
// was allocated for verification. If not, they are measured on the finished image, include its rounding, and
// bloom is not compared. `bloom_level_size` may be a tier's own number, to compare its shaders with their
// twins. Any thread; uses every core.
FrameVerification verify_frame(FrameMemory& memory, const Plan& plan, const FrameStats& stats,
                               uint32_t bloom_level_size = kWholeBloom);

}  // namespace candela
