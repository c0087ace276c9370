// Exposure over a session's frames: what each frame is rendered with, from what was metered.
#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <optional>
#include <vector>

#include "absl/status/status.h"
#include "server/render/plan/exposure.h"
#include "server/render/plan/plan.h"
#include "server/render/settings/settings.h"

namespace candela {

// Where a session's exposure stands after a frame: all that the next one depends on. A new session's has not
// begun.
struct ExposureState {
  bool begun = false;
  uint64_t sequence = 0;            // of the last frame that was exposed
  int64_t media_time_ns = 0;        // its time
  Exposed exposed;                  // what it was rendered with
  double before = 0.0;              // the factor before it: where it stood on arrival
  bool cut = false;                 // whether it began a scene
  bool cut_pending = false;         // a frame that was to begin one failed: the next one does
  std::optional<ScenePrint> print;  // where cuts are detected

  // Whether that frame is the last one that was exposed: one that comes now with its number repeats it.
  bool is_of(uint64_t frame) const { return begun && sequence == frame; }

  bool operator==(const ExposureState&) const = default;
};

// What was decided for a frame.
struct FrameExposure {
  uint64_t sequence = 0;
  ExposureState state;  // after this frame
};

// The recursion E_i = adapt(E_(i-1), target(m_i), t_i - t_(i-1)) of docs/pipeline.md section 3, where m_i
// also takes in the next `lookahead` frames: the mean of theirs and its own with weights N + 1 - j for the
// j-th later one. A frame is decided once those frames are metered, or a cut or the end bounds them; which
// frames count never depends on when they come. Pure: the same calls give the same bits. Not thread-safe.
class ExposureTrack {
 public:
  // `cut_threshold_ev` 0: cuts are where the frames say so.
  ExposureTrack(uint32_t lookahead, double cut_threshold_ev, ExposureState state);

  // The next frame, before it is metered; frames come in order. `settings` decide its exposure. The number of
  // the last frame again repeats it: it takes the exposure of its first time and leaves no trace.
  // INVALID_ARGUMENT for a lower number or an earlier time.
  absl::Status add(uint64_t sequence, int64_t media_time_ns, bool cut, const ExposureSettings& settings);

  // What metering that frame came to; once, in any order. `failed`: it has no exposure, and has its place in
  // the look-ahead of others without a weight, so that they do not wait for another one.
  void metered(uint64_t sequence, const FrameStats& stats);
  void failed(uint64_t sequence);

  // No more frames come.
  void end() { ended_ = true; }

  // The next frame that is decided, in order; none while it waits for later ones.
  std::optional<FrameExposure> next();

 private:
  struct Waiting {
    uint64_t sequence;
    int64_t media_time_ns;
    bool cut;
    ExposureSettings settings;
    std::optional<FrameStats> stats = std::nullopt;
    bool failed = false;
  };

  Waiting& unmetered(uint64_t sequence);
  bool begins_scene(size_t index) const;
  // The look-ahead's mean for the first frame, which is metered; none while a later one is missing.
  std::optional<double> mean_of_first() const;

  const uint32_t lookahead_;
  const double cut_threshold_ev_;
  ExposureState state_;  // after the last frame that was decided
  bool ended_ = false;
  bool any_ = false;            // a frame came, in this session or before it was resumed;
  uint64_t last_sequence_ = 0;  // the last one's number
  int64_t last_time_ns_ = 0;    // and time
  std::deque<Waiting> frames_;  // added and not decided
};

}  // namespace candela
