// Pictures that need no file: test scenes, the sample picture and the sample panorama.
#pragma once

#include <cstdint>

#include "absl/status/statusor.h"
#include "client/image/image.h"
#include "client/image/scenes.h"

namespace candela {

// A test scene as an image.

// The scene as halves. Fails like make_image().
absl::StatusOr<Image> scene_image(uint32_t width, uint32_t height, const scenes::TexelFunction& texel);

// A procedural HDR scene, for a first picture without any file and for tests.

// An evening: an analytic sky, a sun of 1e5, lamps of several colours on dark ground, deep shadow near 1e-3,
// and a test strip with a grey ramp (2^-10 .. 2^6) above all hues (2^-6 .. 2^3). The format is kRgba32f,
// Rec.709, without alpha. The same size gives the same bits wherever IEEE arithmetic and libm agree. Any size
// from 1x1 works. Fails like make_image().
absl::StatusOr<Image> sample_scene(uint32_t width, uint32_t height);

// Frame `index` of a sequence of `frames`: the same evening, which moves by one pixel per frame. The first
// half of the sequence is darker by 6 EV and the second half brighter by 6 EV. Values above 60000 become
// 60000. The format is kRgba16f; otherwise like sample_scene().
absl::StatusOr<Image> sample_sequence_frame(uint32_t width, uint32_t height, uint64_t index, uint64_t frames);

}  // namespace candela
