#include "tests/support/simulated/undisturbed_run.h"

#include <utility>

namespace candela::testing {
namespace {

// A frame as the exposure of others sees it.
struct Seen {
  SimulatedScene scene;
  absl::Status status;
  bool repeats = false;  // the last frame before it that did not fail: it changes nothing
  bool begins = false;   // a scene

  bool has_mean() const { return status.ok() && scene.stats().metered_weight > 0; }
};

std::vector<Seen> see(const std::vector<SimulatedFrame>& frames, double cut_threshold_ev) {
  std::vector<Seen> all;
  std::optional<uint64_t> last;
  std::optional<ScenePrint> print;
  for (const SimulatedFrame& frame : frames) {
    Seen seen{SimulatedScene(frame.desc, frame.pixels), absl::OkStatus()};
    seen.status = seen.scene.check(frame.settings);
    seen.repeats = last == frame.sequence;
    const bool differs = cut_threshold_ev > 0 && seen.has_mean() && print &&
                         scene_difference(*print, seen.scene.stats().print) > cut_threshold_ev;
    seen.begins = !seen.repeats && (frame.cut || differs);
    if (seen.status.ok() && !seen.repeats) {
      last = frame.sequence;
      if (seen.has_mean()) print = seen.scene.stats().print;
    }
    all.push_back(std::move(seen));
  }
  return all;
}

// The mean over frame `first` and those after it that it looks ahead to.
double mean_from(const std::vector<Seen>& seen, size_t first, uint32_t lookahead) {
  double sum = 0.0;
  uint32_t weights = 0;
  uint32_t later = 0;
  for (size_t i = first; i < seen.size() && later <= lookahead; ++i) {
    if (seen[i].repeats) continue;
    if (i > first && seen[i].begins) break;
    const uint32_t weight = seen[i].has_mean() ? lookahead + 1 - later : 0;
    sum += weight * seen[i].scene.stats().mean_log2_luminance;
    weights += weight;
    ++later;
  }
  return sum / weights;
}

}  // namespace

std::vector<SimulatedAnswer> undisturbed_run(const std::vector<SimulatedFrame>& frames, uint32_t lookahead,
                                             double cut_threshold_ev) {
  const std::vector<Seen> seen = see(frames, cut_threshold_ev);
  std::vector<SimulatedAnswer> answers;
  std::optional<Exposed> exposed;  // of the last frame
  int64_t time_ns = 0;             // of that frame
  bool begins_next = false;        // a frame that was to begin a scene could not
  double before = 0.0;
  bool cut = false;
  for (size_t i = 0; i < frames.size(); ++i) {
    const SimulatedFrame& frame = frames[i];
    if (!seen[i].status.ok()) {
      begins_next |= frame.cut && !seen[i].repeats;
      answers.push_back({seen[i].status, {}, {}});
      continue;
    }
    if (!seen[i].repeats) {
      std::optional<double> mean = seen[i].scene.stats().metered_mean();
      if (mean && !frame.given) mean = mean_from(seen, i, lookahead);
      std::optional<PreviousExposure> previous;
      cut = mean && (begins_next || seen[i].begins);
      if (exposed && !cut) {
        previous = {exposed->exposure, static_cast<double>(frame.media_time_ns - time_ns) * 1e-9};
      }
      cut |= frame.cut;
      exposed = expose(frame.settings->exposure(), previous, mean, frame.given);
      before = previous && !cut ? previous->exposure : exposed->exposure;
      time_ns = frame.media_time_ns;
      begins_next = !mean && (begins_next || frame.cut);
    }
    answers.push_back({absl::OkStatus(), *exposed,
                       seen[i].scene.image(frame.settings, frame.sequence, exposed->exposure), before, cut});
  }
  return answers;
}

}  // namespace candela::testing
