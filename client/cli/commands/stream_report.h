// What `candela stream` says about its frames, for people and for programs.
#pragma once

#include <cstdint>
#include <set>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/time/time.h"
#include "client/session.h"

namespace candela {

// What became of one frame of the sequence.
struct StreamFrame {
  uint64_t index = 0;  // of the file; also its sequence number
  std::string input;
  std::string output;
  int64_t media_time_ns = 0;
  absl::Status status;      // why there is no image: the file's, the frame's or the writing's
  v1::ResultHeader header;  // where there is one
  absl::Duration latency;
};

// A point of the exposure's curve.
struct ExposurePoint {
  double seconds = 0;  // media time
  double exposure = 1;
  double target = 1;
  double mean_log2_luminance = 0;
  bool cut = false;
};

struct StreamSummary {
  uint64_t frames = 0;  // files
  uint64_t written = 0;
  uint64_t skipped = 0;    // unreadable, or refused by the server
  absl::Duration time;     // from the first frame to the last image
  absl::Duration latency;  // of all frames together
  std::vector<ExposurePoint> curve;
  SessionStats session;
  std::set<std::string> notes;  // what was to be said of the files
};

// One line: frame, input, output, media_time_ns, and then either error or width, height, exposure,
// exposure_before, target, mean_log2_luminance, min_luminance, max_luminance, cut, tier, stage_ms,
// latency_ms.
std::string to_json(const StreamFrame& frame);

// One line: summary {frames, written, skipped, seconds, frames_per_second, mean_latency_ms, resumes,
// frames_sent_again, seconds_without_results, server}.
std::string to_json(const StreamSummary& summary);

// Some lines, each ended. `where`: the first image and the last.
std::string to_text(const StreamSummary& summary, const std::string& where);

// "exposure 1.25 (+0.32 EV)"
std::string exposure_words(double exposure);

// Draws exposure, target and luminance over media time into a .png or .svg, by its extension.
absl::Status plot_exposure(const std::vector<ExposurePoint>& curve, const std::string& path);

// Whether that can be done: a usage error for another extension, FAILED_PRECONDITION without gnuplot.
absl::Status check_plot(const std::string& path);

}  // namespace candela
