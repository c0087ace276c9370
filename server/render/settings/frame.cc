#include "server/render/settings/frame.h"

#include "absl/strings/str_format.h"
#include "proto/candela/v1/settings.h"

namespace candela {

absl::Status check_frame(const FrameDesc& desc, const FrameLimits& limits) {
  if (desc.width == 0 || desc.height == 0) {
    return absl::InvalidArgumentError(
        absl::StrFormat("frame is %dx%d pixels; both sides must be at least 1", desc.width, desc.height));
  }
  if (desc.width > limits.max_dimension || desc.height > limits.max_dimension) {
    return absl::ResourceExhaustedError(absl::StrFormat(
        "frame is %dx%d pixels and this server takes at most %d a side; scale it down or send it in parts",
        desc.width, desc.height, limits.max_dimension));
  }
  // This divides because the product may not fit into 64 bits.
  if (desc.row_bytes() > limits.max_frame_bytes / desc.height) {
    return absl::ResourceExhaustedError(absl::StrFormat(
        "frame is %d bytes (%dx%d %s) and this server takes at most %d; send %sfewer pixels", desc.bytes(),
        desc.width, desc.height, v1::word_of(desc.format), limits.max_frame_bytes,
        desc.format == v1::PIXEL_FORMAT_RGBA32F ? "half floats or " : ""));
  }
  return absl::OkStatus();
}

}  // namespace candela
