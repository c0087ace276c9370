// JPEG in memory: codes for libjpeg, and the segments of a file.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "server/encode/picture.h"

namespace candela {

// What libjpeg encodes: rows of codes. Internal to server/encode.

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

// The segments of a JPEG file. Source: ITU-T T.81, annex B.

inline constexpr uint8_t kApp0 = 0xe0, kApp1 = 0xe1, kApp2 = 0xe2;
inline constexpr absl::string_view kExifName{"Exif\0\0", 6};  // begins the body of an APP1

struct JpegSegment {
  uint8_t marker = 0;      // its second byte, such as kApp1
  absl::string_view body;  // what follows the length
};

struct JpegSegments {
  std::vector<JpegSegment> before_scans;  // in the file's order
  size_t after_head = 0;                  // where the first segment that is neither APP0 nor APP1 begins
  // Where the picture ends: behind its end marker, or before what is none of its segments, such as the next
  // picture. 0: it has no such end in the file.
  size_t end = 0;

  // The body of the first segment before the scans that begins with `name`, without it.
  std::optional<absl::string_view> named(uint8_t marker, absl::string_view name) const;
};

// Finds the segments of the picture that begins with the first byte. The result points into `file`. What is
// between the scans and behind the picture is skipped. INVALID_ARGUMENT, whose message does not name the
// file, if no picture begins there, a segment before the scans is not whole, or there are more than 4096.
absl::StatusOr<JpegSegments> jpeg_segments(absl::string_view file);

}  // namespace candela
