// The exposure files of one run of `candela stream` or `candela meter`: the one that is read and the one that
// is saved.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client/run/exposure/exposure_file.h"
#include "client/run/options.h"
#include "client/run/sequence/sequence.h"

namespace candela {

class ShotExposures {
 public:
  // Reads the file that the options name, if any, and checks that the one to save can be written. `options`
  // must outlive this.
  static absl::StatusOr<ShotExposures> open(const StreamOptions& options);

  // The sequence that the user chose, with the frame rate and the time 0 of the file that was read, so that
  // frames have the numbers and times that they had there. A usage error if the user gave another rate.
  absl::StatusOr<SequenceChoice> choice() const;

  // Refuses a sequence with frames that have no exposure in the file, unless bad frames are skipped, and one
  // that does not come after the state. Returns notes about it.
  absl::StatusOr<std::vector<std::string>> check(const Sequence& sequence) const;

  // The frame rate that the user or the file that was read gives.
  std::optional<FrameRate> rate() const { return read_ ? read_->rate : options_.sequence.rate; }
  bool fixes_rate() const { return read_.has_value(); }

  // The exposures that frames are given, by their numbers.
  const GivenExposures& given() const { return given_; }
  // The state that the session continues after.
  std::optional<v1::SessionState> state() const;

  // The frame of that state.
  std::optional<int64_t> after() const;

  // Makes the folder of the file to save, and fails if it cannot be written. Call it after the outputs are
  // checked.
  absl::Status prepare_save() const;
  // True if the exposures are saved. Then the session returns its states.
  bool saved() const { return !options_.save_exposures.empty(); }
  // Writes the file. `state` is the session's after the last of `frames`, of which there is at least one.
  absl::Status save(const Sequence& sequence, FrameRate rate, const std::vector<ExposedFrame>& frames,
                    const v1::SessionState& state) const;

 private:
  explicit ShotExposures(const StreamOptions& options) : options_(options) {}
  absl::Status check_after_state(const Sequence& sequence) const;

  const StreamOptions& options_;
  std::string path_;  // of the file that was read; empty: none
  std::optional<ExposureFile> read_;
  GivenExposures given_;
};

}  // namespace candela
