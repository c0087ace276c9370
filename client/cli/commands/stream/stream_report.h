// The results of `candela stream`, as text, JSON and a plot.
#pragma once

#include <cstdint>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/time/time.h"
#include "client/base/failure.h"
#include "client/cli/files/exposure_file.h"
#include "client/cli/files/primaries_used.h"
#include "client/cli/files/sequence/sequence.h"
#include "client/cli/options/options.h"
#include "client/session.h"

namespace candela {

// The outcome of one frame of the sequence.
struct StreamFrame {
  int64_t number = 0;
  std::string input;  // of a held frame: the one that it repeats
  std::string output;
  int64_t media_time_ns = 0;
  bool held = false;     // has the image of the one before
  bool missing = false;  // has no file
  PrimariesUsed primaries;
  uint64_t missing_pixels = 0;  // of an unfinished or damaged file
  absl::Status status;          // why there is no image of its own: reading or rendering failed
  v1::ResultHeader header;      // only if the frame was rendered
  absl::Duration latency;
};

struct StreamSummary {
  uint64_t frames = 0;  // files
  int64_t first = 0;    // the number of the first one
  int64_t last = 0;     // and of the last one
  std::string missing;  // numbers without a file, as --range takes them
  ChosenRate rate;
  uint64_t written = 0;  // without held ones
  uint64_t held = 0;
  uint64_t skipped = 0;                    // unreadable, or refused by the server
  std::optional<FailureKind> skipped_for;  // their common kind; nothing: none was skipped
  absl::Duration time;                     // from the first frame to the last image
  absl::Duration latency;                  // the sum over all frames
  std::vector<ExposedFrame> curve;
  double locked = 1;       // the locked exposure of the curve
  std::string saved;       // the exposure file that is written; "": none
  v1::SessionState state;  // after the last frame, if it is saved
  SessionStats session;
  PictureDefaults defaults;
  std::string view;                 // view_words() of --ocio, "" without it
  std::set<std::string> notes;      // notes about the files
  std::set<std::string> primaries;  // words_of() of those that frames had
};

// One line with the keys frame (its number), input, output, media_time_ns, and either error (text) and code
// (the exit code of such a failure), held (true) or all three, or primaries {name, xy, from}, width, height,
// exposure, exposure_before, target, target_before_limits, mean_log2_luminance, min_luminance, max_luminance,
// bad_values {nan, inf, negative}, clamped_components, absent_pixels, missing_pixels, gamut_cut_components,
// cut, tier, stage_ms, latency_ms.
std::string to_json(const StreamFrame& frame);

// One line with the key summary {frames, first, last, missing, fps, fps_from, written, held, skipped,
// seconds, frames_per_second, mean_latency_ms, resumes, frames_sent_again, seconds_without_results, server}.
std::string to_json(const StreamSummary& summary);

// Several lines, each with a line end. `where` names the first and the last image; "": there are none.
std::string to_text(const StreamSummary& summary, const std::string& where);

// Says that the session lost a server and resumed, in one sentence.
std::string resume_words(const SessionStats& stats);

}  // namespace candela
