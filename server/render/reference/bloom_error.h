// Compares the device's bloom with the reference's.
#pragma once

#include "server/render/reference/reference_frame.h"

namespace candela {

// The largest error of the light that bloom adds at an intensity of 1, at the texels of the reference's level
// 0 and relative to the largest value there; 0 if the settings ask for no bloom. `rendered`: the device made
// bloom; otherwise its light counts as 0. A device's level of half the reference's size is sampled as resolve
// does.
double bloom_error(const ReferenceFrame& truth, const FrameTextures& textures, bool rendered);

}  // namespace candela
