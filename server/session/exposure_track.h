// The exposure of a session's frames, decided from what was metered.
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

// A session's exposure after a frame: everything that the exposure of the next frame depends on. The default
// is a session without frames.
struct ExposurePoint {
  bool begun = false;
  uint64_t sequence = 0;      // of the last frame that was exposed
  int64_t media_time_ns = 0;  // of that frame
  Exposed exposed;            // what it was rendered with
  double before = 0.0;        // the exposure that it adapted from
  bool cut = false;           // whether it began a scene
  // A frame that was to begin a scene failed, or nothing of it was metered, so the next one begins it.
  bool cut_pending = false;
  std::optional<ScenePrint> print;  // the last there was; only if cuts are detected

  // Whether that was the last frame that was exposed. A new frame with the same number repeats it.
  bool is_of(uint64_t frame) const { return begun && sequence == frame; }

  bool operator==(const ExposurePoint&) const = default;
};

// The decision for one frame.
struct FrameExposure {
  uint64_t sequence = 0;
  ExposurePoint point;  // after this frame
};

// Computes the recursion E_i = adapt(E_(i-1), target(m_i), t_i - t_(i-1)) of docs/pipeline.md section 3. With
// look-ahead, m_i is the weighted mean of frame i and the next `lookahead` frames; the j-th later frame has
// weight lookahead + 1 - j. A frame is decided once all those frames are metered, or fewer if a cut or the
// end of the session comes first. Which frames count never depends on when they arrive. Pure: the same calls
// give the same bits. Not thread-safe.
class ExposureTrack {
 public:
  // Continues after `point`. With a `cut_threshold_ev` of 0 only the frames' own flags mark cuts.
  ExposureTrack(uint32_t lookahead, double cut_threshold_ev, ExposurePoint point);

  // Adds the next frame, before it is metered. Frames are added in order. `given` is the exposure that the
  // frame brings, if any. A frame with the number of the frame before repeats it: it gets the same exposure
  // and does not affect later frames. INVALID_ARGUMENT for a lower number, an earlier time, a factor out of
  // its range, or a repeat with another exposure.
  absl::Status add(uint64_t sequence, int64_t media_time_ns, bool cut, const v1::Exposure& settings,
                   std::optional<double> given = std::nullopt);

  // Each frame that was added is metered or fails, once and in any order. A failed frame has no exposure. It
  // keeps its position in the look-ahead of other frames, with no weight, so that they do not wait for one
  // frame more. So does a frame with nothing metered, which keeps the exposure before it.
  void metered(uint64_t sequence, const FrameStats& stats);
  void failed(uint64_t sequence);

  // No more frames are added.
  void end() { ended_ = true; }

  // The next decided frame, in order; nothing while it waits for later frames.
  std::optional<FrameExposure> next();

 private:
  struct Waiting {
    uint64_t sequence;
    int64_t media_time_ns;
    bool cut;
    v1::Exposure settings;
    std::optional<double> given;
    std::optional<FrameStats> stats = std::nullopt;
    bool failed = false;

    // Has metered pixels, so it has weight and a picture.
    bool has_mean() const { return stats && stats->metered_weight > 0; }
  };

  absl::Status check_order(uint64_t sequence, int64_t media_time_ns) const;
  Waiting& unmetered(uint64_t sequence);
  bool begins_scene(size_t index) const;
  // The mean over the look-ahead of the first frame, which has a mean; nothing while a later one is missing.
  std::optional<double> mean_of_first() const;
  // The mean that decides the first frame, which is metered: its own if its exposure is given.
  std::optional<double> deciding_mean() const;
  double before_limits_again(const Waiting& frame) const;
  // The session's exposure after the first frame, which has that mean; absent if nothing of it is metered.
  ExposurePoint after_first(std::optional<double> mean) const;

  const uint32_t lookahead_;
  const double cut_threshold_ev_;
  ExposurePoint point_;  // after the last frame that was decided
  bool ended_ = false;
  // The last frame that was added, here or in the session that is resumed.
  bool any_ = false;
  uint64_t last_sequence_ = 0;
  int64_t last_time_ns_ = 0;
  std::optional<double> last_given_;
  std::deque<Waiting> frames_;  // added and not decided
};

}  // namespace candela
