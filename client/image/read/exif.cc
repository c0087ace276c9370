#include "client/image/read/exif.h"

#include <algorithm>
#include <cstring>

#include "absl/strings/match.h"

namespace candela {

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

std::optional<TiffBytes::Tag> TiffBytes::tag_in(size_t directory, uint32_t id) const {
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

int orientation_of(absl::string_view exif) {
  constexpr uint32_t kOrientation = 0x112, kShort = 3;
  const TiffBytes bytes(exif);
  const std::optional<TiffBytes::Tag> tag = bytes.tag(kOrientation);
  if (!tag || tag->type != kShort) return 1;
  const uint32_t turn = bytes.number_16(tag->value_at).value_or(1);
  return turn >= 1 && turn <= 8 ? static_cast<int>(turn) : 1;
}

// Source: CIPA DC-008 (Exif) and DC-009 (DCF).
bool is_adobe_rgb(absl::string_view exif) {
  constexpr uint32_t kExifDirectory = 0x8769, kColorSpace = 0xa001, kUncalibrated = 0xffff;
  constexpr uint32_t kInteroperability = 0xa005, kIndex = 1;
  const TiffBytes bytes(exif);
  const auto number = [&bytes](const std::optional<TiffBytes::Tag>& tag) {
    return tag ? bytes.number_32(tag->value_at).value_or(0) : 0;
  };
  const std::optional<TiffBytes::Tag> directory = bytes.tag(kExifDirectory);
  if (!directory) return false;
  const std::optional<TiffBytes::Tag> space = bytes.tag_in(number(directory), kColorSpace);
  if (!space || bytes.number_16(space->value_at) != kUncalibrated) return false;
  const std::optional<TiffBytes::Tag> rules = bytes.tag_in(number(directory), kInteroperability);
  const std::optional<TiffBytes::Tag> index = rules ? bytes.tag_in(number(rules), kIndex) : std::nullopt;
  return index && absl::StartsWith(exif.substr(index->value_at), "R03");
}

std::optional<double> apple_number(absl::string_view exif, uint32_t id) {
  constexpr uint32_t kExifDirectory = 0x8769, kMakerNote = 0x927c, kSignedFraction = 10;
  constexpr absl::string_view kApple{"Apple iOS\0\0\1MM", 14};  // then the note's directory
  const TiffBytes all(exif);
  const std::optional<TiffBytes::Tag> directory = all.tag(kExifDirectory);
  if (!directory) return std::nullopt;
  const std::optional<TiffBytes::Tag> found =
      all.tag_in(all.number_32(directory->value_at).value_or(0), kMakerNote);
  if (!found) return std::nullopt;
  const size_t at = std::min<size_t>(all.number_32(found->value_at).value_or(0), exif.size());
  const absl::string_view bytes = exif.substr(at, found->count);
  if (!absl::StartsWith(bytes, kApple)) return std::nullopt;
  // Its places count from its own beginning.
  const TiffBytes note(bytes, true);
  const std::optional<TiffBytes::Tag> tag = note.tag_in(kApple.size(), id);
  if (!tag || tag->type != kSignedFraction) return std::nullopt;
  const size_t value_at = note.number_32(tag->value_at).value_or(0);
  const std::optional<uint32_t> over = note.number_32(value_at), under = note.number_32(value_at + 4);
  if (!over || !under || *under == 0) return std::nullopt;
  return static_cast<double>(static_cast<int32_t>(*over)) / static_cast<int32_t>(*under);
}

void Turned::put_row(std::span<const float> row, uint32_t y, Image& image) const {
  for (uint32_t x = 0; x < width_; ++x) {
    const auto [to_x, to_y] = place(x, y);
    std::memcpy(image.pixels.data() + to_y * image.row_bytes() + size_t{16} * to_x, &row[size_t{4} * x], 16);
  }
}

}  // namespace candela
