#include "client/image/read/jpeg_facts.h"

#include <algorithm>
#include <array>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
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

// A big-endian number of four bytes; those that are missing are 0.
size_t number_at(absl::string_view bytes, size_t at) {
  size_t v = 0;
  for (size_t i = 0; i < 4; ++i)
    v = v << 8 | (at + i < bytes.size() ? static_cast<uint8_t>(bytes[at + i]) : 0);
  return v;
}

// `bytes` of `whole`, as many as there are.
absl::string_view piece(absl::string_view whole, size_t at, size_t bytes) {
  return at < whole.size() ? whole.substr(at, bytes) : absl::string_view();
}

// What the profile calls itself, in its first language; "" if it cannot be read. lcms2 would take the memory
// that a damaged profile asks for. Source: ICC.1:2001 section 6.5.17, ICC.1:2010 section 10.13.
std::string description_of(absl::string_view profile) {
  constexpr size_t kTagsAt = 128, kMostTags = 256, kMostLetters = 200;
  absl::string_view tag;
  for (size_t i = 0; i < std::min(number_at(profile, kTagsAt), kMostTags) && tag.empty(); ++i) {
    const size_t at = kTagsAt + 4 + 12 * i;
    if (piece(profile, at, 4) == "desc")
      tag = piece(profile, number_at(profile, at + 4), number_at(profile, at + 8));
  }
  if (absl::StartsWith(tag, "desc")) {
    const absl::string_view text = piece(tag, 12, std::min(number_at(tag, 8), kMostLetters));
    return std::string(text.substr(0, text.find('\0')));
  }
  std::string letters;
  if (!absl::StartsWith(tag, "mluc")) return letters;
  const absl::string_view text =
      piece(tag, number_at(tag, 24), std::min(number_at(tag, 20), 2 * kMostLetters));
  for (size_t i = 0; i + 1 < text.size(); i += 2) {  // UTF-16
    letters.push_back(text[i] == '\0' && text[i + 1] != '\0' ? text[i + 1] : '?');
  }
  return letters;
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
  const std::string description = description_of(profile);
  if (description.empty()) {
    notes.push_back("its ICC profile cannot be read: taken as sRGB");
  } else if (set_by_profile_name(description, signal)) {
    signal.source = "ICC";
  } else {
    notes.push_back(absl::StrFormat("the ICC profile \"%s\" is none that Candela knows: taken as sRGB",
                                    printable(description)));
  }
  return signal;
}

}  // namespace candela
