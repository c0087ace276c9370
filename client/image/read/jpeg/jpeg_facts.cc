#include "client/image/read/jpeg/jpeg_facts.h"

#include <algorithm>
#include <array>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/image/read/icc_name.h"
#include "client/image/read/readers.h"

namespace candela {
namespace {

// The profile of all its parts, which are numbered from 1. "" if there is none, or one of them is missing.
// Source: ICC.1:2010, annex B.4.
std::string icc_profile_of(const JpegSegments& segments, bool& is_there) {
  constexpr absl::string_view kName{"ICC_PROFILE\0", 12};
  std::array<absl::string_view, 256> parts{};
  size_t count = 0;
  for (const JpegSegment& segment : segments.before_scans) {
    if (segment.marker != kApp2 || !absl::StartsWith(segment.body, kName)) continue;
    is_there = true;
    if (segment.body.size() < kName.size() + 2) return "";
    count = static_cast<uint8_t>(segment.body[kName.size() + 1]);
    parts[static_cast<uint8_t>(segment.body[kName.size()])] = segment.body.substr(kName.size() + 2);
  }
  std::string profile;
  for (size_t i = 1; i <= count; ++i) {
    if (parts[i].empty()) return "";
    absl::StrAppend(&profile, parts[i]);
  }
  return profile;
}

}  // namespace

TiffBytes::TiffBytes(absl::string_view bytes)
    : bytes_(bytes), big_endian_(absl::StartsWith(bytes, absl::string_view("MM\0\x2a", 4))) {
  if (!big_endian_ && !absl::StartsWith(bytes, absl::string_view("II\x2a\0", 4))) bytes_ = {};
}

std::optional<uint32_t> TiffBytes::number(size_t at, size_t size) const {
  if (at > bytes_.size() || bytes_.size() - at < size) return std::nullopt;
  uint32_t v = 0;
  for (size_t i = 0; i < size; ++i) {
    v = v << 8 | static_cast<uint8_t>(bytes_[big_endian_ ? at + i : at + size - 1 - i]);
  }
  return v;
}

std::optional<TiffBytes::Tag> TiffBytes::tag(uint32_t id) const {
  const size_t directory = number_32(4).value_or(0);
  const uint32_t count = number_16(directory).value_or(0);
  for (uint32_t i = 0; i < count; ++i) {
    const size_t at = directory + 2 + size_t{12} * i;
    if (number_16(at) != id) continue;
    const std::optional<uint32_t> type = number_16(at + 2), values = number_32(at + 4);
    if (!type || !values || !number_32(at + 8)) return std::nullopt;
    return Tag{*type, *values, at + 8};
  }
  return std::nullopt;
}

int orientation_of(const JpegSegments& segments) {
  constexpr absl::string_view kExif{"Exif\0\0", 6};
  constexpr uint32_t kOrientation = 0x112, kShort = 3;
  for (const JpegSegment& segment : segments.before_scans) {
    if (segment.marker != kApp1 || !absl::StartsWith(segment.body, kExif)) continue;
    const TiffBytes exif(segment.body.substr(kExif.size()));
    const std::optional<TiffBytes::Tag> tag = exif.tag(kOrientation);
    if (!tag || tag->type != kShort) return 1;
    const uint32_t turn = exif.number_16(tag->value_at).value_or(1);
    return turn >= 1 && turn <= 8 ? static_cast<int>(turn) : 1;
  }
  return 1;
}

Signal signal_of_jpeg(const JpegSegments& segments, std::vector<std::string>& notes) {
  Signal signal;
  bool has_profile = false;
  const std::string profile = icc_profile_of(segments, has_profile);
  if (!has_profile) return signal;
  // lcms2 would take the memory that a damaged profile asks for.
  const std::string description = icc_name(profile);
  if (description.empty()) {
    notes.push_back("its ICC profile cannot be read: taken as sRGB");
  } else {
    take_profile("ICC", description, signal, notes);
  }
  return signal;
}

}  // namespace candela
