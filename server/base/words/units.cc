#include "server/base/words/units.h"

#include <limits>

#include "absl/strings/ascii.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

namespace candela {
namespace {

struct Suffix {
  const char* text;
  uint32_t shift;
};
constexpr Suffix kSuffixes[] = {{"TiB", 40}, {"GiB", 30}, {"MiB", 20}, {"KiB", 10}, {"", 0}};

// The power of two that `suffix` stands for, or -1 if it is unknown.
int shift_of(const std::string& suffix) {
  for (const Suffix& known : kSuffixes) {
    if (suffix == absl::AsciiStrToLower(known.text)) return static_cast<int>(known.shift);
  }
  return -1;
}

}  // namespace

absl::StatusOr<uint64_t> parse_bytes(const std::string& text) {
  const size_t digits = std::min(text.find_first_not_of("0123456789"), text.size());
  const int shift = shift_of(absl::AsciiStrToLower(text.substr(digits)));
  uint64_t count = 0;
  if (shift < 0 || !absl::SimpleAtoi(text.substr(0, digits), &count) ||
      count > std::numeric_limits<uint64_t>::max() >> shift) {
    return absl::InvalidArgumentError(
        absl::StrFormat("'%s' is not a number of bytes; write 1048576, 512MiB or 2GiB", text));
  }
  return count << shift;
}

std::string format_bytes(uint64_t bytes) {
  for (const Suffix& suffix : kSuffixes) {
    const uint64_t count = bytes >> suffix.shift;
    if (count != 0 && count << suffix.shift == bytes) return absl::StrCat(count, suffix.text);
  }
  return "0";
}

absl::StatusOr<absl::Duration> parse_duration(const std::string& text) {
  absl::Duration duration;
  if (!absl::ParseDuration(text, &duration)) {
    return absl::InvalidArgumentError(absl::StrFormat("'%s' is not a time; write 60s, 1m30s or 500ms", text));
  }
  return duration;
}

}  // namespace candela
