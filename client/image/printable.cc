// Texts of files for messages.
#include <cstdint>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/image/read/readers.h"

namespace candela {
namespace {

// Characters that end lines, hide themselves or turn the direction of the text around them.
bool is_control(uint32_t code) {
  constexpr struct {
    uint32_t first, last;
  } kControls[] = {{0x80, 0x9f},     {0xad, 0xad},      {0x061c, 0x061c}, {0x180e, 0x180e},
                   {0x200b, 0x200f}, {0x2028, 0x202e},  {0x2060, 0x206f}, {0xfeff, 0xfeff},
                   {0xfff9, 0xfffb}, {0xe0000, 0xe007f}};
  for (const auto& range : kControls) {
    if (code >= range.first && code <= range.last) return true;
  }
  return false;
}

// The bytes of the text's first character; 0 if it is not UTF-8 or cannot be printed. `text` is not empty.
size_t printable_bytes(absl::string_view text) {
  const auto byte = [&](size_t i) { return static_cast<unsigned char>(text[i]); };
  if (byte(0) < 0x80) return absl::ascii_isprint(byte(0)) ? 1 : 0;
  if (byte(0) < 0xc2 || byte(0) > 0xf4) return 0;
  const size_t bytes = byte(0) >= 0xf0 ? 4 : byte(0) >= 0xe0 ? 3 : 2;
  if (text.size() < bytes) return 0;
  uint32_t code = byte(0) & (0x7fu >> bytes);
  for (size_t i = 1; i < bytes; ++i) {
    if ((byte(i) & 0xc0) != 0x80) return 0;
    code = code << 6 | (byte(i) & 0x3fu);
  }
  constexpr uint32_t kLeast[] = {0, 0, 0x80, 0x800, 0x10000};
  const bool surrogate = code >= 0xd800 && code <= 0xdfff;
  return code < kLeast[bytes] || code > 0x10ffff || surrogate || is_control(code) ? 0 : bytes;
}

}  // namespace

std::string printable(absl::string_view text, size_t most) {
  std::string result;
  for (size_t i = 0; i < text.size() && i < most;) {
    const size_t bytes = printable_bytes(text.substr(i));
    if (bytes > 0) {
      absl::StrAppend(&result, text.substr(i, bytes));
    } else {
      absl::StrAppendFormat(&result, "\\x%02x", static_cast<unsigned char>(text[i]));
    }
    i += bytes > 0 ? bytes : 1;
  }
  return result;
}

}  // namespace candela
