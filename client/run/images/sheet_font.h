// Letters for contact sheets: 5 x 7 dots of ASCII.
#pragma once

#include <array>
#include <cstdint>

namespace candela {

inline constexpr uint32_t kLetterWidth = 6, kLetterHeight = 9;  // dots, with the space to the next

// The columns of a letter from left to right; the lowest bit is the top dot. Of another byte, those of "?".
const std::array<uint8_t, 5>& letter(char c);

}  // namespace candela
