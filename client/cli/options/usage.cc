#include "client/cli/options/usage.h"

#include <algorithm>
#include <numeric>

#include "absl/strings/match.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"

namespace candela {
namespace {

constexpr char kUsagePayload[] = "candela.usage";

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

absl::Status usage_error(const std::string& message) {
  absl::Status status = absl::InvalidArgumentError(message);
  status.SetPayload(kUsagePayload, absl::Cord());
  return status;
}

bool is_usage_error(const absl::Status& status) { return status.GetPayload(kUsagePayload).has_value(); }

std::string nearest(const std::string& typed, const std::vector<std::string>& words) {
  std::string best;
  size_t least = std::max<size_t>(1, typed.size() / 3) + 1;
  for (const std::string& word : words) {
    const size_t distance = edit_distance(typed, word);
    if (distance < least) {
      least = distance;
      best = word;
    }
  }
  if (!best.empty() || typed.empty()) return best;
  const auto begins = [&typed](const std::string& word) { return absl::StartsWith(word, typed); };
  const auto first = std::find_if(words.begin(), words.end(), begins);
  return std::count_if(words.begin(), words.end(), begins) == 1 ? *first : "";
}

absl::Status unknown_word(const std::string& what, const std::string& typed,
                          const std::vector<std::string>& words) {
  const std::string meant = nearest(typed, words);
  const std::string all = absl::StrJoin(words, ", ");
  if (meant.empty())
    return usage_error(absl::StrFormat("unknown %s \"%s\"; there are: %s", what, typed, all));
  return usage_error(
      absl::StrFormat("unknown %s \"%s\"; did you mean %s? There are: %s", what, typed, meant, all));
}

}  // namespace candela
