// What a frame is: its size, its pixel format on the wire, and where its bytes lie.
#pragma once

#include <cstdint>

#include "absl/status/status.h"

namespace candela {

// Wire formats, as docs/pipeline.md section 1. Values are those of candela.v1.PixelFormat.
enum class PixelFormat : uint32_t { kRgba16f = 1, kRgba32f = 2, kRgb9e5 = 3 };

// Values are those of candela.v1.OutputFormat.
enum class OutputFormat : uint32_t { kRgba8 = 1, kRgba16 = 2, kRgba16f = 3 };

constexpr uint32_t bytes_per_pixel(PixelFormat format) {
  return format == PixelFormat::kRgba16f ? 8 : format == PixelFormat::kRgba32f ? 16 : 4;
}
constexpr uint32_t bytes_per_pixel(OutputFormat format) { return format == OutputFormat::kRgba8 ? 4 : 8; }

const char* name(PixelFormat format);   // "rgba16f"
const char* name(OutputFormat format);  // "rgba8"

// A frame as its header announces it. Sizes are in pixels; `row_bytes` and `bytes` are of tight rows.
struct FrameDesc {
  uint32_t width = 0;
  uint32_t height = 0;
  PixelFormat format = PixelFormat::kRgba16f;

  uint64_t row_bytes() const { return uint64_t{width} * bytes_per_pixel(format); }
  uint64_t bytes() const { return row_bytes() * height; }
};

// What one server accepts. `max_frame_bytes` also keeps within what the device can allocate.
struct FrameLimits {
  uint32_t max_dimension = 0;
  uint64_t max_frame_bytes = 0;
};

// INVALID_ARGUMENT for an empty frame, RESOURCE_EXHAUSTED for one beyond the limits. Touches no memory.
absl::Status check_frame(const FrameDesc& desc, const FrameLimits& limits);

}  // namespace candela
