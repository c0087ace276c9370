// Compares a rendered image with OpenColorIO's own result for the same view.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "absl/status/statusor.h"
#include "candela/v1/render.pb.h"
#include "client/color/view_table.h"
#include "proto/candela/v1/image_size.h"

namespace candela {

// A frame as its file has it, and what came back. Rows have no padding.
struct ViewedFrame {
  v1::PixelFormat format = v1::PIXEL_FORMAT_RGBA16F;  // RGBA16F or RGBA32F
  std::span<const std::byte> pixels;                  // the file's own values
  v1::ImageSize size;                                 // of the frame
  v1::Settings settings;                              // as sent, but the table is not used
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

// Compares the image with what OpenColorIO itself makes of the file's values. OpenColorIO shows the values
// directly if nothing changes them before the view (exposure 1, no bloom, no white balance, no other size)
// and ViewTable::input names their colour space. Otherwise OpenColorIO or the primaries of the settings make
// scene light of them, bloom and resizing follow in float64, and ViewTable::show shows the result at the
// header's exposure. Nothing is rounded to half, and nothing is cut. NaN is taken as 0 and Inf as +-65504.
// Fails as Settings do on the server, for settings that it would refuse. Takes about 2 seconds a megapixel
// and 60 bytes a pixel. Any thread.
absl::StatusOr<ViewError> error_of_view(const ViewTable& view, const ViewedFrame& frame);

}  // namespace candela
