// Letters for contact sheets: ASCII in 5 x 8 dots, the font 5x8 of the X Window System (font-misc-misc),
// which is in the public domain.
#pragma once

#include <array>
#include <cstdint>

namespace candela {

inline constexpr uint32_t kLetterWidth = 5, kLetterHeight = 8;  // dots, with the space to the next

// The columns of a letter from left to right; the lowest bit is the top dot. Of another byte, those of "?".
const std::array<uint8_t, kLetterWidth>& letter(char c);

}  // namespace candela
