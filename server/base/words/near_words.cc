#include "server/base/words/near_words.h"

#include <algorithm>
#include <numeric>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"

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

}  // namespace candela
