#include "server/render/settings/tier_choice.h"

#include <algorithm>
#include <vector>

#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "server/base/rounded_up.h"

namespace candela {

namespace {

std::string words(const TierNumbers& n) { return absl::StrFormat("%s takes %.3g ms", n.tier, n.ms); }

std::string words(const v1::Settings& settings) {
  std::vector<std::string> parts;
  if (settings.has_max_error_codes())
    parts.push_back(absl::StrFormat("max_error_codes %g", settings.max_error_codes()));
  if (settings.has_max_ms()) parts.push_back(absl::StrFormat("max_ms %g", settings.max_ms()));
  return absl::StrJoin(parts, " with ");
}

std::string words(const Tier& tier, double bound) {
  return bound < kNoBound
             ? absl::StrFormat("%s is within %s codes of the reference", tier.name, rounded_up(bound))
             : absl::StrFormat("%s has no bound", tier.name);
}

std::string words(const BoundFacts& facts) {
  return absl::StrFormat("%s%s", facts.blooms ? "it blooms" : "nothing in it blooms",
                         facts.wide ? " and it has negative components" : "");
}

}  // namespace

absl::StatusOr<TierChoice> choose_by_time(std::span<const TierNumbers> numbers, const Settings& settings) {
  const TierNumbers* chosen = nullptr;
  for (const TierNumbers& n : numbers) {
    if (n.ms <= settings->max_ms()) chosen = &n;
  }
  const auto too_slow = [&](const TierNumbers& nearest) {
    return absl::FailedPreconditionError(absl::StrFormat(
        "no tier keeps %s for frames of this size with these settings on this device; closest: %s",
        words(*settings), words(nearest)));
  };
  const auto faster = [](const TierNumbers& a, const TierNumbers& b) { return a.ms < b.ms; };
  if (chosen == nullptr) return too_slow(*std::min_element(numbers.begin(), numbers.end(), faster));
  if (settings->has_max_error_codes()) {
    const auto accurate = std::find_if(numbers.begin(), numbers.end(), [&](const TierNumbers& n) {
      return error_bound(*find_tier(n.tier), settings, easiest_facts()) <= settings->max_error_codes();
    });
    if (accurate != numbers.end() && &*accurate > chosen) return too_slow(*accurate);
  }
  std::vector<std::string> others;
  for (const TierNumbers& n : numbers) {
    if (n.tier != chosen->tier) others.push_back(words(n));
  }
  return TierChoice{chosen->tier, absl::StrFormat("%s, the median measured here; it keeps %s%s%s",
                                                  words(*chosen), words(*settings),
                                                  others.empty() ? "" : "; ", absl::StrJoin(others, ", "))};
}

std::string reason_for(const Tier& tier, double bound, const Settings& settings, const BoundFacts& facts) {
  std::string cheaper;
  for (const Tier& other : tiers()) {
    if (&other >= &tier) break;
    cheaper += absl::StrFormat("; %s here", words(other, error_bound(other, settings, facts)));
  }
  return absl::StrFormat("%s for this frame: %s; it keeps %s%s", words(tier, bound), words(facts),
                         words(*settings), cheaper);
}

absl::Status no_tier_keeps(const Settings& settings, const BoundFacts& facts) {
  const Tier& closest = settings.costliest_tier() != nullptr ? *settings.costliest_tier() : tiers().back();
  return absl::FailedPreconditionError(absl::StrFormat(
      "no tier keeps %s for this frame: %s; closest: %s, and only slower tiers are more accurate",
      words(*settings), words(facts), words(closest, error_bound(closest, settings, facts))));
}

}  // namespace candela
