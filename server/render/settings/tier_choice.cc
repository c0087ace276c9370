#include "server/render/settings/tier_choice.h"

#include <algorithm>
#include <vector>

#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"

namespace candela {

namespace {

std::string words(const TierNumbers& n) {
  return absl::StrFormat("%s takes %.3g ms with at most %.3g codes of error", n.tier, n.ms,
                         n.max_error_codes);
}

std::string words(const v1::Settings& settings) {
  std::vector<std::string> parts;
  if (settings.has_max_error_codes())
    parts.push_back(absl::StrFormat("max_error_codes %g", settings.max_error_codes()));
  if (settings.has_max_ms()) parts.push_back(absl::StrFormat("max_ms %g", settings.max_ms()));
  return absl::StrJoin(parts, " with ");
}

bool faster(const TierNumbers& a, const TierNumbers& b) { return a.ms < b.ms; }
bool more_accurate(const TierNumbers& a, const TierNumbers& b) {
  return a.max_error_codes < b.max_error_codes;
}

}  // namespace

absl::StatusOr<TierChoice> choose_tier(std::span<const TierNumbers> numbers, const v1::Settings& settings) {
  std::vector<TierNumbers> accurate;  // tiers that keep max_error_codes
  std::vector<TierNumbers> keeping;   // tiers that keep both
  for (const TierNumbers& n : numbers) {
    if (settings.has_max_error_codes() && n.max_error_codes > settings.max_error_codes()) continue;
    accurate.push_back(n);
    if (!settings.has_max_ms() || n.ms <= settings.max_ms()) keeping.push_back(n);
  }
  if (keeping.empty()) {
    // The closest: the fastest tier that is accurate enough, or else the most accurate one.
    const TierNumbers& nearest = accurate.empty()
                                     ? *std::min_element(numbers.begin(), numbers.end(), more_accurate)
                                     : *std::min_element(accurate.begin(), accurate.end(), faster);
    return absl::FailedPreconditionError(absl::StrFormat(
        "no tier keeps %s for frames of this size with these settings on this device; closest: %s",
        words(settings), words(nearest)));
  }
  const TierNumbers& chosen = settings.has_max_error_codes()
                                  ? *std::min_element(keeping.begin(), keeping.end(), faster)
                                  : *std::min_element(keeping.begin(), keeping.end(), more_accurate);
  std::vector<std::string> others;
  for (const TierNumbers& n : numbers) {
    if (n.tier != chosen.tier) others.push_back(words(n));
  }
  return TierChoice{chosen.tier,
                    absl::StrFormat("%s, as measured here; it keeps %s%s%s", words(chosen), words(settings),
                                    others.empty() ? "" : "; ", absl::StrJoin(others, ", "))};
}

}  // namespace candela
