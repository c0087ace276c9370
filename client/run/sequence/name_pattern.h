// A file's path with a number in its name: frame.%04d.exr, frame.####.exr or frame.@@@@.exr.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "absl/status/statusor.h"

namespace candela {

struct NamePattern {
  std::string before;  // the path up to the number
  std::string after;   // the rest of the file's name
  int digits = 0;      // of the number, at least; zeros fill them. A minus counts as one: %04d makes -005.
  bool minus_beside = false;  // a minus comes before all of the digits: -0005

  std::string path(int64_t number) const;  // frame.0012.exr
  std::string text() const;                // frame.%04d.exr

  // Whether a file that has a number below 0 in its name is read back with that number: its minus must be a
  // sign, see begins_number().
  bool keeps_sign() const;
};

// Whether a minus at this place of a path or a file's name is a sign: at the name's beginning, and after "."
// or "_". Elsewhere it separates: in shot-1001.exr, 1001 is the number.
bool begins_number(const std::string& path, size_t at);

// Finds the number in the file's name; the folder's name is only text. It is %d or %04d. If there is no %, it
// is a run of # or of @, with as many digits at least: #### is %04d, and a single # or @ is %d. Returns
// nothing if the name has none of them. A usage error for two numbers, and for any other use of %.
absl::StatusOr<std::optional<NamePattern>> parse_name_pattern(const std::string& path);

// The number that stands between the first `before` and the last `after` characters of `text`, a path or a
// file's name. Nothing if that is not a number of 1 .. kMostDigits digits, with a minus only where it is a
// sign.
std::optional<int64_t> number_between(const std::string& text, size_t before, size_t after);

}  // namespace candela
