// Compares an image and its bloom with the reference, component by component.
#pragma once

#include <cstddef>
#include <cstdint>

#include "server/render/reference/reference_frame.h"
#include "server/render/reference/verify.h"

namespace candela {

// A finished image as the host sees it.
struct Picture {
  const std::byte* texels;
  uint32_t pitch;   // texels from row to row
  uint32_t format;  // OUTPUT_*

  // Component k of a texel as a display value.
  double component(uint32_t x, uint32_t y, size_t k) const;
};

// Fills in everything but meter_error_ev and bloom_error. `codes` is the image on which codes are measured,
// `image` the one that the client gets. `map` receives the largest error of each texel, as halves in rows
// without a gap; null: no map. Uses every core.
Verification compare(const ReferenceFrame& truth, const Picture& codes, const Picture& image, uint16_t* map);

// The largest error of the light that bloom adds at an intensity of 1, at the texels of the reference's level
// 0 and relative to the largest value there; 0 if the settings ask for no bloom. `rendered`: the device made
// bloom; otherwise its light counts as 0. A device's level of half the reference's size is sampled as resolve
// does.
double bloom_error(const ReferenceFrame& truth, const FrameTextures& textures, bool rendered);

}  // namespace candela
