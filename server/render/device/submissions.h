// Submissions to the device, cut by how fast it has done each kind of work before.
#pragma once

#include <cstdint>
#include <map>
#include <span>
#include <vector>

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "server/render/plan/frame_stats.h"
#include "server/render/plan/lit_area.h"
#include "server/vulkan/recorder.h"

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

// What the device does for one phase of a frame: one submission or, in slices, several.
//
// If the calling thread runs in slices (server/base/slices.h), a stage is cut where a submission would take
// longer than a slice, and checkpoint() is called between two submissions; other frames may use the recorder
// there. Otherwise all stages are one submission. The bits are the same. begin(); stages and what else is
// recorded; end(). One thread at a time.
class Submissions {
 public:
  // Records units `first` to `last` - 1 of a stage.
  using Record = absl::FunctionRef<absl::Status(uint64_t first, uint64_t last)>;

  // Adds times to *stages. `pages`: the device's memory is the host's, so a stage that writes fresh pages is
  // far slower than the last frame's, and begins with little. All of them outlive it.
  Submissions(Recorder& recorder, Pace& pace, bool pages, std::vector<StageTime>* stages);

  absl::Status begin();
  // A pass with these work groups, each of which makes `texels`. The units are rows of groups. Rows that have
  // no group may be among them.
  absl::Status pass(const char* stage, std::span<const Box> groups, double texels, Record record);
  // A copy, or the like, of so many bytes. The units are bytes, cut at multiples of 1 MiB.
  absl::Status copy(const char* stage, uint64_t bytes, Record record);
  // Blocks until the device is done. Fails as Recorder::submit_and_wait does, and so do the others.
  absl::Status end();

 private:
  // Units of `costs`; each is `unit` of what `record` counts.
  absl::Status cut(const char* stage, std::span<const double> costs, uint64_t unit, uint64_t end,
                   Record record);
  absl::Status submit();

  Recorder& recorder_;
  Pace& pace_;
  std::vector<StageTime>* stages_;
  const double first_cost_;
  const bool in_slices_;
  double most_seconds_ = 0.0;              // that the submission may take
  double expected_seconds_ = 0.0;          // of what is recorded
  std::map<const char*, double> costs_{};  // of what is recorded, by stage
};

}  // namespace candela
