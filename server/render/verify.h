// A frame held against the float64 reference.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "server/render/renderer.h"
#include "shaders/reference.h"

namespace candela {

struct ReferenceFrame {
  reference::BadCounts bad;
  reference::Meter meter;
  // Display values before quantising, row by row, RGBA.
  std::vector<std::array<double, 4>> image;
};

// The whole pipeline in float64 at the given exposure factor E. `wire`: tight rows. Needs about 100 bytes a
// pixel. `bloom_level_size`: 2 is the pipeline; 4 what a tier makes of it, to hold that tier's shaders to
// their twins.
ReferenceFrame render_reference(const FrameDesc& desc, std::span<const std::byte> wire,
                                const Settings& settings, double exposure, uint32_t bloom_level_size = 2);

// How far an image is from the reference, over R, G and B. A code is 1/255 of the display range.
struct Difference {
  double max_codes = 0.0;
  double p999_codes = 0.0;
  double mean_codes = 0.0;
  uint32_t worst_x = 0;
  uint32_t worst_y = 0;
  uint64_t components = 0;
  uint64_t differing = 0;       // components whose quantised values differ
  double max_difference = 0.0;  // of quantised values, in steps of the output format
};

// `memory` holds the finished image of the format that `settings` name. Its own rounding is part of the
// error, so measure codes on kRgba16 and count differing components on kRgba8.
Difference compare(const FrameMemory& memory, const Settings& settings, const ReferenceFrame& reference);

}  // namespace candela
