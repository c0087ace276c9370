// The error of a rendered frame against the float64 reference.
#pragma once

#include <cstdint>

#include "server/render/plan/frame_stats.h"

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

}  // namespace candela
