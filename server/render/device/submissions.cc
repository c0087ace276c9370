#include "server/render/device/submissions.h"

#include <algorithm>
#include <chrono>
#include <limits>

#include "server/base/check.h"
#include "server/base/slices.h"
#include "server/base/status_macros.h"

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

namespace {

using Steady = std::chrono::steady_clock;

// Less is not worth a submission.
constexpr double kLeastSeconds = 0.002;
// Less is not cut further: each piece of a box of groups is a dispatch of its own, so many small submissions
// take longer than a few.
constexpr double kLeastCost = 1 << 18;
constexpr uint64_t kCopyUnit = uint64_t{1} << 20;
constexpr double kTexelBytes = 16;  // of a copy, which costs as much as a texel of a pass at most

std::vector<double> costs_of_rows(std::span<const Box> groups, double texels) {
  std::vector<double> costs;
  for (const Box& box : groups) {
    if (costs.size() < box.y1) costs.resize(box.y1);
    for (uint32_t y = box.y0; y < box.y1; ++y) costs[y] += texels * (box.x1 - box.x0);
  }
  return costs;
}

}  // namespace

Submissions::Submissions(Recorder& recorder, Pace& pace, bool pages, std::vector<StageTime>* stages)
    : recorder_(recorder),
      pace_(pace),
      stages_(stages),
      first_cost_(pages ? kLeastCost : std::numeric_limits<double>::infinity()),
      in_slices_(slice_end() != Steady::time_point::max()) {}

absl::Status Submissions::begin() {
  checkpoint();
  // What is left of the slice. If nothing is, one unit.
  const double left = std::chrono::duration<double>(slice_end() - Steady::now()).count();
  most_seconds_ = left <= 0 ? 0 : std::clamp(left, kLeastSeconds, Pace::kSubmissionSeconds);
  return recorder_.begin();
}

absl::Status Submissions::pass(const char* stage, std::span<const Box> groups, double texels, Record record) {
  if (in_slices_) return cut(stage, costs_of_rows(groups, texels), 1, UINT64_MAX, record);
  recorder_.mark(stage);
  return record(0, UINT64_MAX);
}

absl::Status Submissions::copy(const char* stage, uint64_t bytes, Record record) {
  if (in_slices_) {
    const std::vector<double> costs((bytes + kCopyUnit - 1) / kCopyUnit, kCopyUnit / kTexelBytes);
    return cut(stage, costs, kCopyUnit, bytes, record);
  }
  recorder_.mark(stage);
  return record(0, bytes);
}

absl::Status Submissions::cut(const char* stage, std::span<const double> costs, uint64_t unit, uint64_t end,
                              Record record) {
  double most_cost = first_cost_;  // twice as much for each submission of the stage
  for (size_t first = 0; first < costs.size();) {
    const double pace = pace_.of(stage);
    double left = std::min((most_seconds_ - expected_seconds_) / pace, most_cost);
    if (expected_seconds_ == 0 && most_seconds_ > 0) left = std::max(left, kLeastCost);
    double cost = costs[first];
    size_t last = first + 1;
    while (last < costs.size() && cost + costs[last] <= left) cost += costs[last++];
    if (cost > left && expected_seconds_ > 0) {
      RETURN_IF_ERROR(submit());
      RETURN_IF_ERROR(begin());
      continue;
    }
    recorder_.mark(stage);
    if (absl::Status status = record(first * unit, last == costs.size() ? end : last * unit); !status.ok()) {
      return status;
    }
    expected_seconds_ += cost * pace;
    costs_[stage] += cost;
    first = last;
    if (first == costs.size()) break;
    RETURN_IF_ERROR(submit());
    RETURN_IF_ERROR(begin());
    most_cost *= 2;
  }
  return absl::OkStatus();
}

absl::Status Submissions::submit() {
  recorder_.barrier_to_host();
  const Steady::time_point begin = Steady::now();
  RETURN_IF_ERROR(recorder_.submit_and_wait());
  const double seconds = std::chrono::duration<double>(Steady::now() - begin).count();
  std::map<const char*, double> took;
  for (const Recorder::Timing& timing : recorder_.timings()) {
    add_time({timing.name, timing.ns}, stages_);
    took[timing.name] += 1e-9 * static_cast<double>(timing.ns);
  }
  for (const auto& [stage, cost] : costs_) {
    if (cost == 0) continue;
    // A device without times of its own: each stage has its share.
    pace_.learn(stage, cost,
                took.empty() ? cost * pace_.of(stage) * seconds / expected_seconds_ : took[stage]);
  }
  costs_.clear();
  expected_seconds_ = 0.0;
  return absl::OkStatus();
}

absl::Status Submissions::end() { return submit(); }

}  // namespace candela
