// Exposure files: the exposures of a sequence's frames, which `candela meter` and `candela stream` write, and
// from which a sequence is rendered again, in parts or continued. docs/exposures.md describes the format.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "candela/v1/render.pb.h"
#include "client/image/image.h"
#include "client/run/options.h"
#include "client/run/sequence.h"

namespace candela {

// The exposure of one frame.
struct ExposedFrame {
  int64_t frame = 0;          // its number
  int64_t media_time_ns = 0;  // as in render.proto
  double exposure = 1;        // the factor E, 2^-40 .. 2^40
  double target = 1;
  double mean_log2_luminance = 0;
  bool cut = false;
};

struct ExposureFile {
  FrameRate rate;
  int64_t zero = 0;                  // the number of the frame at media time 0
  v1::Exposure settings;             // what decided the exposures; for people
  uint32_t lookahead = 0;            // likewise
  double cut_threshold_ev = 0;       // likewise
  std::vector<ExposedFrame> frames;  // in order; frames that failed are not among them
  double locked = 1;                 // one exposure for all frames
  v1::SessionState state;            // after the last frame; its sequence counts from `zero`

  int64_t last() const { return zero + static_cast<int64_t>(state.sequence()); }  // the state's frame
};

// The locked exposure of frames that were metered with `settings`, see docs/pipeline.md section 3. `settings`
// may leave out defaults; they are within their ranges.
double locked_exposure(const v1::Exposure& settings, const std::vector<ExposedFrame>& frames);

// The file's text, and the reverse. Numbers survive bit for bit. INVALID_ARGUMENT, without a file's name,
// says what is wrong with the text.
std::string to_text(const ExposureFile& file);
absl::StatusOr<ExposureFile> parse_exposures(const std::string& text);

// Reads a file of at most 256 MiB. Errors begin with the path.
absl::StatusOr<ExposureFile> read_exposures(const std::string& path);

// The exposures that frames are given.
class GivenExposures {
 public:
  GivenExposures() = default;  // none
  // Each frame gets the exposure of its number in `file`, which was read from `path`.
  static GivenExposures each(std::string path, ExposureFile file);
  // All frames get this factor.
  static GivenExposures locked(double exposure);

  // Nothing if frames are not given exposures. INVALID_ARGUMENT if the file does not have the frame.
  absl::StatusOr<std::optional<double>> of(int64_t frame) const;

 private:
  std::string path_;  // empty: no file
  std::vector<ExposedFrame> frames_;
  std::optional<double> locked_;
};

// The exposure files of one run of `candela stream` or `candela meter`: the one that is read and the one that
// is saved.
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
