// A frame's size and pixel format on the wire, and the limits on them.
#pragma once

#include <cstdint>

#include "absl/status/status.h"
#include "candela/v1/render.pb.h"
#include "proto/candela/v1/pixel_size.h"

namespace candela {

// A frame as its header describes it. Sizes are in pixels; `row_bytes` and `bytes` are without row padding.
struct FrameDesc {
  uint32_t width = 0;
  uint32_t height = 0;
  v1::PixelFormat format = v1::PIXEL_FORMAT_RGBA16F;

  uint64_t row_bytes() const { return uint64_t{width} * bytes_per_pixel(format); }
  uint64_t bytes() const { return row_bytes() * height; }
};

// The largest frame that a server accepts. `max_frame_bytes` is never more than the device can allocate.
struct FrameLimits {
  uint32_t max_dimension = 0;
  uint64_t max_frame_bytes = 0;
};

// INVALID_ARGUMENT for an empty frame, RESOURCE_EXHAUSTED for one over the limits. Allocates nothing.
absl::Status check_frame(const FrameDesc& desc, const FrameLimits& limits);

}  // namespace candela
