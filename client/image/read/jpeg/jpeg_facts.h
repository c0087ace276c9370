// Facts about a picture from the segments of its JPEG file. Internal to client/image.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/strings/string_view.h"
#include "client/image/read/signal.h"
#include "server/encode/jpeg_segments.h"

namespace candela {

// Numbers behind a TIFF header, which Exif and MPF begin with. Source: TIFF 6.0, section 2.
class TiffBytes {
 public:
  struct Tag {
    uint32_t type, count;
    size_t value_at;  // four bytes: the value, or where it is
  };

  explicit TiffBytes(absl::string_view bytes);

  // Absent if the bytes end before it, or have no TIFF header.
  std::optional<uint32_t> number_16(size_t at) const { return number(at, 2); }
  std::optional<uint32_t> number_32(size_t at) const { return number(at, 4); }
  // The tag of the first directory; absent if it has none.
  std::optional<Tag> tag(uint32_t id) const;

 private:
  std::optional<uint32_t> number(size_t at, size_t size) const;

  absl::string_view bytes_;
  bool big_endian_;
};

// Exif's orientation, 1 .. 8. 1, which turns nothing, if the file names none.
int orientation_of(const JpegSegments& segments);

// The signal by the file's ICC profile, else sRGB. Says in `notes` if the profile is not used.
Signal signal_of_jpeg(const JpegSegments& segments, std::vector<std::string>& notes);

}  // namespace candela
