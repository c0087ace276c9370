// A procedural HDR scene, for a first picture without any file and for tests that want one.
#pragma once

#include <cstdint>

#include "client/image/image.h"

namespace candela {

// An evening: analytic sky, a sun of 1e5, lamps of several colours on dark ground, deep shadow near 1e-3, and
// a strip with a grey ramp (2^-10 .. 2^6) over all hues (2^-6 .. 2^3). kRgba32f, Rec.709, without alpha; the
// same bits for the same size everywhere IEEE arithmetic and libm agree. Any size from 1x1; fails as
// make_image does.
absl::StatusOr<Image> sample_scene(uint32_t width, uint32_t height);

// Frame `index` of a sequence of `frames`: the same evening, moving by a pixel from frame to frame, darker by
// 2^-6 in the first half of the frames and brighter by 2^6 from the middle on, with what is above 60000 cut
// to that. kRgba16f, otherwise as sample_scene.
absl::StatusOr<Image> sample_sequence_frame(uint32_t width, uint32_t height, uint64_t index, uint64_t frames);

}  // namespace candela
