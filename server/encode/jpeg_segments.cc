#include "server/encode/jpeg_segments.h"

#include "absl/strings/str_format.h"

namespace candela {
namespace {

constexpr size_t kMostSegments = 4096;
constexpr uint8_t kStart = 0xd8, kEnd = 0xd9, kScan = 0xda;

uint8_t byte_at(absl::string_view file, size_t at) { return static_cast<uint8_t>(file[at]); }

// Markers without a length: TEM and those that restart a scan.
bool stands_alone(uint8_t marker) { return marker == 0x01 || (marker >= 0xd0 && marker <= 0xd7); }

// Where the codes of a scan end that begin at `at`: at a marker that does not belong to them, or at the end.
size_t scan_end(absl::string_view file, size_t at) {
  while ((at = file.find('\xff', at)) != absl::string_view::npos && at + 1 < file.size()) {
    const uint8_t next = byte_at(file, at + 1);
    if (next != 0 && next != 0xff && !stands_alone(next)) return at;
    at += next == 0xff ? 1 : 2;
  }
  return file.size();
}

}  // namespace

absl::StatusOr<JpegSegments> jpeg_segments(absl::string_view file) {
  if (file.size() < 4 || byte_at(file, 0) != 0xff || byte_at(file, 1) != kStart) {
    return absl::InvalidArgumentError("no JPEG picture begins there");
  }
  JpegSegments found;
  bool in_head = true, before_scans = true;
  for (size_t at = 2; at + 2 <= file.size();) {
    const auto damaged = [&](const char* why) {
      return absl::InvalidArgumentError(absl::StrFormat("%s at byte %d", why, at));
    };
    if (byte_at(file, at) != 0xff) {
      if (before_scans) return damaged("there is no marker");
      return found;
    }
    const uint8_t marker = byte_at(file, at + 1);
    if (marker == 0xff || stands_alone(marker)) {  // 0xff fills
      at += marker == 0xff ? 1 : 2;
      continue;
    }
    if (in_head && marker != kApp0 && marker != kApp1) {
      in_head = false;
      found.after_head = at;
    }
    if (marker == kEnd) {
      found.end = at + 2;
      return found;
    }
    const size_t length =
        at + 4 <= file.size() ? size_t{byte_at(file, at + 2)} << 8 | byte_at(file, at + 3) : 0;
    if (length < 2 || length > file.size() - at - 2) {
      if (before_scans) return damaged("a segment is not whole");
      return found;
    }
    if (marker == kScan) {
      before_scans = false;
      at = scan_end(file, at + 2 + length);
      continue;
    }
    if (before_scans) {
      if (found.before_scans.size() == kMostSegments) return damaged("there is one segment too many");
      found.before_scans.push_back({marker, file.substr(at + 4, length - 2)});
    }
    at += 2 + length;
  }
  if (before_scans) return absl::InvalidArgumentError("the file ends before its first scan");
  return found;
}

}  // namespace candela
