// Compares an image with the reference, component by component.
#pragma once

#include <cstddef>
#include <cstdint>

#include "server/render/reference/reference_frame.h"
#include "server/render/reference/verification.h"

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

}  // namespace candela
