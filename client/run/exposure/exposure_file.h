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
#include "client/image/frame_rate.h"

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

}  // namespace candela
