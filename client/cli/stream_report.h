// The report of a sequence: text, JSON and a plot.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/time/time.h"
#include "client/run/exposure_file.h"
#include "client/run/picture_frame.h"
#include "client/run/report.h"
#include "client/run/sequence.h"
#include "client/session.h"

namespace candela {

// The results of `candela stream`, as text, JSON and a plot.

// One line with the keys frame (its number), input, output, media_time_ns, and either error (text) and code
// (the exit code of such a failure), held (true) or all three, or primaries {name, xy, from}, width, height,
// exposure, exposure_before, target, target_before_limits, mean_log2_luminance, min_luminance, max_luminance,
// bad_values {nan, inf, negative}, clamped_components, absent_pixels, missing_pixels, gamut_cut_components,
// cut, tier, stage_ms, latency_ms.
std::string to_json(const RunFrame& frame);

// One line with the key summary {frames, first, last, missing, fps, fps_from, written, held, skipped,
// seconds, frames_per_second, mean_latency_ms, resumes, frames_sent_again, seconds_without_results, server}.
std::string to_json(const RunSummary& summary);

// Several lines, each with a line end. `where` names the first and the last image; "": there are none.
std::string to_text(const RunSummary& summary, const std::string& where);

// Says that the session lost a server and resumed, in one sentence.
std::string resume_words(const SessionStats& stats);

// A plot of a sequence's exposure over media time, as an .svg file.

// Checks before the work that the plot can be written. A usage error for another extension than .svg.
absl::Status check_plot(const std::string& path);

// Draws exposure, target and mean luminance, in EV, and marks cuts. There is at least one frame.
absl::Status plot_exposure(const std::vector<ExposedFrame>& curve, const std::string& path);

}  // namespace candela
