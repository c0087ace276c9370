// What libjpeg encodes: rows of codes. Internal to server/encode.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

#include "absl/status/status.h"
#include "server/encode/picture.h"

namespace candela {

enum class JpegPixel { kGrey, kRgb, kRgbx };  // the fourth component of kRgbx is skipped

// Rows from top to bottom, a byte a component. Does not own the codes.
struct JpegCodes {
  uint32_t width = 0;   // pixels
  uint32_t height = 0;  // pixels
  JpegPixel pixel = JpegPixel::kRgbx;
  const std::byte* rows = nullptr;
  size_t row_stride_bytes = 0;
  // The width : height of one pixel.
  uint16_t aspect_width = 1;
  uint16_t aspect_height = 1;
};

// Encodes them with colour at full resolution (4:4:4). `profile` is an ICC profile, or "" for none. INTERNAL
// with libjpeg's reason, or if the sink returned false.
absl::Status encode_jpeg_codes(const JpegCodes& codes, int quality, const std::string& profile,
                               ByteSink sink);

}  // namespace candela
