// Compares a rendered image with OpenColorIO's own result for the same view.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>

#include "absl/status/statusor.h"
#include "candela/v1/render.pb.h"

namespace candela {

// A frame as it was sent, and what came back. Rows have no padding.
struct ViewedFrame {
  v1::PixelFormat format = v1::PIXEL_FORMAT_RGBA16F;
  std::span<const std::byte> pixels;
  v1::Settings settings;    // as sent, but the table is not used
  v1::ResultHeader header;  // with the image's size and format, the exposure and the metered mean
  std::span<const std::byte> image;
};

// Errors over R, G and B of the opaque pixels, in 1/255 of the view's range. The image's own rounding and
// dither are part of them. A NaN counts as an infinite error.
struct ViewError {
  double max_codes = 0.0;
  double p999_codes = 0.0;
  double mean_codes = 0.0;
  uint32_t worst_x = 0;
  uint32_t worst_y = 0;
  uint64_t pixels = 0;  // that were compared; 0 if none is opaque
};

// Makes the scene of the wire's pixels and its bloom in float64, exposes it as the header says, and shows it
// by `show` (ViewTable::show). The light is not cut. Fails as Settings do on the server, for settings that it
// would refuse. Takes about 2 seconds a megapixel and 60 bytes a pixel. Any thread.
absl::StatusOr<ViewError> error_of_view(const std::function<void(std::span<float>)>& show,
                                        const ViewedFrame& frame);

}  // namespace candela
