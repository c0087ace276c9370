#include "client/run/sequence/name_pattern.h"

#include <algorithm>

#include "absl/strings/ascii.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_format.h"
#include "client/base/usage.h"
#include "client/run/sequence/frame_numbers.h"

namespace candela {
namespace {

absl::Status not_one_number(const std::string& path) {
  return usage_error(absl::StrFormat(
      "%s: a pattern has one number, %%d, %%04d, #### or @@@@, in its file name, and no other %%", path));
}

// `at` is the place of the first % in the file's name.
absl::StatusOr<std::optional<NamePattern>> parse_percent(const std::string& path, size_t at) {
  size_t end = at + 1;
  while (end < path.size() && absl::ascii_isdigit(path[end])) ++end;
  int digits = 0;
  if (end > at + 1 && !absl::SimpleAtoi(path.substr(at + 1, end - at - 1), &digits)) digits = kMostDigits + 1;
  if (end >= path.size() || path[end] != 'd' || digits > kMostDigits ||
      path.find('%', end) != std::string::npos) {
    return not_one_number(path);
  }
  return NamePattern{path.substr(0, at), path.substr(end + 1), digits};
}

}  // namespace

std::string NamePattern::path(int64_t number) const {
  const int width = digits + (minus_beside && number < 0 ? 1 : 0);
  return absl::StrFormat("%s%0*d%s", before, width, number, after);
}

std::string NamePattern::text() const {
  return absl::StrFormat("%s%%%s%s", before, digits > 1 ? absl::StrFormat("0%dd", digits) : "d", after);
}

bool NamePattern::keeps_sign() const { return begins_number(before, before.size()); }

bool begins_number(const std::string& path, size_t at) {
  return at == 0 || path[at - 1] == '.' || path[at - 1] == '_' || path[at - 1] == '/';
}

absl::StatusOr<std::optional<NamePattern>> parse_name_pattern(const std::string& path) {
  const size_t name = path.rfind('/') + 1;  // 0 without a folder
  if (const size_t at = path.find('%', name); at != std::string::npos) return parse_percent(path, at);
  for (const char sign : {'#', '@'}) {
    const size_t at = path.find(sign, name);
    if (at == std::string::npos) continue;
    const size_t end = std::min(path.find_first_not_of(sign, at), path.size());
    if (path.find(sign, end) != std::string::npos || end - at > kMostDigits) return not_one_number(path);
    return NamePattern{path.substr(0, at), path.substr(end), static_cast<int>(end - at)};
  }
  return std::nullopt;
}

std::optional<int64_t> number_between(const std::string& text, size_t before, size_t after) {
  if (text.size() <= before + after) return std::nullopt;
  if (text[before] == '-' && !begins_number(text, before)) return std::nullopt;
  return parse_frame_number(absl::string_view(text).substr(before, text.size() - before - after));
}

}  // namespace candela
