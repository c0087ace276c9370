// How fast the device does each kind of work, learned from what it took before.
#pragma once

#include <map>

namespace candela {

// Tells how much work fits into a submission, so that a slice (server/base/slices.h) is not much longer than
// it should be. One thread at a time.
class Pace {
 public:
  // `first`: the seconds that a unit of cost takes before anything is known.
  explicit Pace(double first) : first_(first) {}

  // The seconds that a unit of cost takes. Work of one kind has one address, such as that of its name.
  double of(const void* kind) const;
  // The cost that a submission should have.
  double affordable(const void* kind) const;
  // Work of this cost took this time. One time may have been disturbed, so the pace changes by a limited
  // factor.
  void learn(const void* kind, double cost, double seconds);

  // A submission aims at this. Work on the same cores may make it half as long again; it should stay within
  // kSlice.
  static constexpr double kSubmissionSeconds = 0.025;

 private:
  const double first_;
  std::map<const void*, double> seconds_per_cost_;
};

}  // namespace candela
