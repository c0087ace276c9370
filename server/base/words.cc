#include "server/base/words.h"

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <map>
#include <numeric>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "absl/strings/string_view.h"
#include "absl/strings/strip.h"

namespace candela {
namespace {

constexpr int kMostThatBegin = 4;

// Insertions, deletions, replacements and swaps of neighbours (optimal string alignment).
size_t edit_distance(const std::string& a, const std::string& b) {
  std::vector<size_t> before, last(b.size() + 1), row(b.size() + 1);
  std::iota(last.begin(), last.end(), 0);
  for (size_t i = 1; i <= a.size(); ++i) {
    row[0] = i;
    for (size_t j = 1; j <= b.size(); ++j) {
      row[j] = std::min({last[j] + 1, row[j - 1] + 1, last[j - 1] + (a[i - 1] != b[j - 1])});
      if (i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1]) {
        row[j] = std::min(row[j], before[j - 2] + 1);
      }
    }
    before = std::exchange(last, row);
  }
  return last[b.size()];
}

}  // namespace

std::string folded(absl::string_view word) {
  std::string letters = absl::AsciiStrToLower(word);
  std::erase_if(letters, [](char c) { return absl::StrContains(" .-_", c); });
  return letters;
}

std::vector<std::string> near_words(absl::string_view typed, const std::vector<std::string>& words) {
  const std::string meant = folded(typed);
  if (meant.empty()) return {};
  std::vector<size_t> distances;
  for (const std::string& word : words) distances.push_back(edit_distance(meant, folded(word)));
  const size_t most = std::min(meant.size() - 1, std::max<size_t>(1, meant.size() / 3));
  const size_t least = words.empty() ? 0 : *std::min_element(distances.begin(), distances.end());
  const auto begins = [&meant](const std::string& word) { return absl::StartsWith(folded(word), meant); };
  const bool few_begin = std::count_if(words.begin(), words.end(), begins) <= kMostThatBegin;
  std::vector<std::string> near;
  for (size_t i = 0; i < words.size(); ++i) {
    const bool is_nearest = distances[i] == least && least <= most;
    if (is_nearest || (few_begin && begins(words[i]))) near.push_back(words[i]);
  }
  return near;
}

std::string did_you_mean(std::vector<std::string> near) {
  if (near.empty()) return "";
  const std::string last = std::move(near.back());
  near.pop_back();
  return absl::StrCat("did you mean ", absl::StrJoin(near, ", "), near.empty() ? "" : " or ", last, "?");
}

namespace {

double value_of(const std::string& text) {
  double value = 0;
  (void)absl::SimpleAtod(text, &value);
  return value;
}

}  // namespace

std::string rounded_up(double bound) {
  if (bound == 0) return "0";
  const double digit = std::pow(10.0, std::floor(std::log10(bound)) - 2);
  const std::string nearest = absl::StrFormat("%.3g", bound);
  return value_of(nearest) >= bound ? nearest : absl::StrFormat("%.3g", value_of(nearest) + digit);
}

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

namespace {

constexpr absl::string_view kPrefix = "CANDELA_";

constexpr const char* kCommandVariables[] = {kServerVariable,   kTlsVariable,     kTlsCaVariable,
                                             kTlsNameVariable,  kTlsCertVariable, kTlsKeyVariable,
                                             kTokenFileVariable};

// Variables of the scripts and tests of this project.
constexpr absl::string_view kOwnToolPrefixes[] = {"CANDELA_DATA",  "CANDELA_DEPLOY_",
                                                  "CANDELA_FUZZ_", "CANDELA_SOAK_SECONDS",
                                                  "CANDELA_TEST_", "CANDELA_UPDATE_PAGES"};

// CANDELA_SERVICE_HOST=10.0.0.1, CANDELA_PORT=tcp://10.0.0.1:50051, CANDELA_PORT_50051_TCP_PROTO=tcp
bool is_service_link(absl::string_view name, absl::string_view value) {
  if (absl::StrContains(name, "_SERVICE_HOST") || absl::StrContains(name, "_SERVICE_PORT")) return true;
  if (absl::StartsWith(value, "tcp://") || absl::StartsWith(value, "udp://")) return true;
  const size_t digit = name.find("_PORT_") + absl::string_view("_PORT_").size();
  return absl::StrContains(name, "_PORT_") && digit < name.size() && absl::ascii_isdigit(name[digit]);
}

bool is_of_own_tools(absl::string_view name) {
  return std::any_of(std::begin(kOwnToolPrefixes), std::end(kOwnToolPrefixes),
                     [name](absl::string_view prefix) { return absl::StartsWith(name, prefix); });
}

}  // namespace

std::vector<UnknownVariable> unknown_variables(const std::vector<std::string>& daemon_variables) {
  std::vector<std::string> known;
  for (const char* name : kCommandVariables) known.emplace_back(absl::StripPrefix(name, kPrefix));
  for (const std::string& name : daemon_variables) known.emplace_back(absl::StripPrefix(name, kPrefix));
  std::map<std::string, std::string> unknown;
  for (char** entry = environ; entry != nullptr && *entry != nullptr; ++entry) {
    const std::pair<absl::string_view, absl::string_view> variable =
        absl::StrSplit(*entry, absl::MaxSplits('=', 1));
    absl::string_view name = variable.first;
    if (is_service_link(name, variable.second) || is_of_own_tools(name)) continue;
    if (!absl::ConsumePrefix(&name, kPrefix)) continue;
    if (std::find(known.begin(), known.end(), name) != known.end()) continue;
    std::vector<std::string> near = near_words(name, known);
    for (std::string& word : near) word = absl::StrCat(kPrefix, word);
    unknown.emplace(variable.first, did_you_mean(std::move(near)));
  }
  std::vector<UnknownVariable> result;
  for (const auto& [name, words] : unknown) result.push_back({name, words});
  return result;
}

}  // namespace candela
