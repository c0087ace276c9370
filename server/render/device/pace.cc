#include "server/render/device/pace.h"

#include <algorithm>

#include "server/base/check.h"

namespace candela {

namespace {

constexpr double kMostFaster = 4.0;
constexpr double kMostSlower = 3.0;
constexpr double kFastestPace = 1e-12;
constexpr double kSlowestPace = 1e-5;

}  // namespace

double Pace::of(const void* kind) const {
  const auto known = seconds_per_cost_.find(kind);
  return known == seconds_per_cost_.end() ? first_ : known->second;
}

double Pace::affordable(const void* kind) const { return kSubmissionSeconds / of(kind); }

void Pace::learn(const void* kind, double cost, double seconds) {
  CHECK(cost > 0 && seconds >= 0);
  double& pace = seconds_per_cost_.try_emplace(kind, first_).first->second;
  pace = std::clamp(seconds / cost, std::max(pace / kMostFaster, kFastestPace),
                    std::min(pace * kMostSlower, kSlowestPace));
}

}  // namespace candela
