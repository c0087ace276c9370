// Source: ICC.1:2001-04 (textDescriptionType) and ICC.1:2022 (multiLocalizedUnicodeType).
#include "client/image/read/icc_name.h"

#include <algorithm>
#include <cstdint>

#include "client/image/read/readers.h"

namespace candela {
namespace {

constexpr size_t kProfileHeader = 128, kMostTags = 256, kMostLetters = 256;

// `size` letters of `letter_bytes` each, up to a zero or the end.
std::string profile_text(absl::string_view bytes, uint64_t at, uint64_t size, size_t letter_bytes) {
  std::string text;
  for (uint64_t i = 0; i < std::min<uint64_t>(size, kMostLetters); ++i) {
    const uint32_t letter = big_endian_at(bytes, at + i * letter_bytes, letter_bytes);
    if (letter == 0) break;
    text.push_back(letter >= 0x20 && letter < 0x7f ? static_cast<char>(letter) : '?');
  }
  return text;
}

}  // namespace

std::string icc_name(absl::string_view profile) {
  const size_t tags = std::min<size_t>(big_endian_at(profile, kProfileHeader), kMostTags);
  for (size_t i = 0; i < tags; ++i) {
    const size_t tag = kProfileHeader + 4 + 12 * i;
    if (profile.substr(std::min(tag, profile.size()), 4) != "desc") continue;
    const uint64_t at = big_endian_at(profile, tag + 4);
    const absl::string_view kind = profile.substr(std::min<uint64_t>(at, profile.size()), 4);
    if (kind == "desc") return profile_text(profile, at + 12, big_endian_at(profile, at + 8), 1);
    // The first of its languages: a length in bytes, and where in the tag the text begins.
    if (kind != "mluc" || big_endian_at(profile, at + 8) == 0) return "";
    return profile_text(profile, at + big_endian_at(profile, at + 24), big_endian_at(profile, at + 20) / 2,
                        2);
  }
  return "";
}

}  // namespace candela
