#include "server/session/exposure_track.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "absl/strings/str_format.h"
#include "proto/candela/v1/limits.h"
#include "server/base/check.h"
#include "server/base/status_macros.h"

namespace candela {

ExposureTrack::ExposureTrack(uint32_t lookahead, double cut_threshold_ev, ExposurePoint point)
    : lookahead_(lookahead),
      cut_threshold_ev_(cut_threshold_ev),
      point_(std::move(point)),
      any_(point_.begun),
      last_sequence_(point_.sequence),
      last_time_ns_(point_.media_time_ns),
      last_given_(point_.begun ? std::optional(point_.exposed.exposure) : std::nullopt) {}

absl::Status ExposureTrack::add(uint64_t sequence, int64_t media_time_ns, bool cut,
                                const v1::Exposure& settings, std::optional<double> given) {
  RETURN_IF_ERROR(check_order(sequence, media_time_ns));
  if (given) {
    RETURN_IF_ERROR(check_factor("frame.exposure", *given));
  }
  const bool repeat = any_ && sequence == last_sequence_;
  if (repeat && given && given != last_given_) {
    return absl::InvalidArgumentError(
        absl::StrFormat("frame.exposure is %.17g and frame %d came first with another exposure; repeat the "
                        "frame unchanged or give it a new number",
                        *given, sequence));
  }
  frames_.push_back({sequence, media_time_ns, cut, settings, given});
  if (!repeat) last_given_ = given;
  any_ = true;
  last_sequence_ = sequence;
  last_time_ns_ = media_time_ns;
  return absl::OkStatus();
}

// A frame may follow the last one that was added.
absl::Status ExposureTrack::check_order(uint64_t sequence, int64_t media_time_ns) const {
  if (media_time_ns < v1::kMediaTimeNs.min || media_time_ns > v1::kMediaTimeNs.max) {
    return absl::InvalidArgumentError(
        absl::StrFormat("frame.media_time_ns is %d; it must be between %d and %d", media_time_ns,
                        v1::kMediaTimeNs.min, v1::kMediaTimeNs.max));
  }
  if (any_ && sequence < last_sequence_) {
    return absl::InvalidArgumentError(
        absl::StrFormat("frame.sequence is %d after %d; the numbers of a session's frames must not decrease",
                        sequence, last_sequence_));
  }
  if (any_ && media_time_ns < last_time_ns_) {
    return absl::InvalidArgumentError(
        absl::StrFormat("frame.media_time_ns is %d after %d; time must not run backwards in a session",
                        media_time_ns, last_time_ns_));
  }
  if (any_ && sequence == last_sequence_ && media_time_ns != last_time_ns_) {
    return absl::InvalidArgumentError(
        absl::StrFormat("frame.media_time_ns is %d and was %d when frame %d came first; repeat the frame "
                        "unchanged or give it a new number",
                        media_time_ns, last_time_ns_, sequence));
  }
  return absl::OkStatus();
}

ExposureTrack::Waiting& ExposureTrack::unmetered(uint64_t sequence) {
  const auto found = std::find_if(frames_.begin(), frames_.end(), [sequence](const Waiting& frame) {
    return frame.sequence == sequence && !frame.stats && !frame.failed;
  });
  CHECK(found != frames_.end());
  return *found;
}

void ExposureTrack::metered(uint64_t sequence, const FrameStats& stats) { unmetered(sequence).stats = stats; }

void ExposureTrack::failed(uint64_t sequence) { unmetered(sequence).failed = true; }

// The frame is metered, and every frame before it is metered or has failed.
bool ExposureTrack::begins_scene(size_t index) const {
  if (frames_[index].cut) return true;
  if (cut_threshold_ev_ == 0.0 || !frames_[index].has_mean()) return false;
  // A failed or unmetered frame between two scenes must not hide the cut: compare with the last picture.
  std::optional<ScenePrint> before = point_.print;
  uint64_t last = point_.sequence;
  bool any = point_.begun;
  for (size_t i = 0; i < index; ++i) {
    const Waiting& frame = frames_[i];
    if (frame.failed || (any && frame.sequence == last)) continue;  // a repeat leaves no trace
    last = frame.sequence;
    any = true;
    if (frame.has_mean()) before = frame.stats->print;
  }
  return before && scene_difference(*before, frames_[index].stats->print) > cut_threshold_ev_;
}

std::optional<double> ExposureTrack::mean_of_first() const {
  // The weights are whole numbers, so that the mean of equal values is exactly that value.
  double sum = 0.0;
  uint32_t weights = 0;
  uint32_t later = 0;
  uint64_t last = 0;
  for (size_t i = 0; i < frames_.size() && later <= lookahead_; ++i) {
    const Waiting& frame = frames_[i];
    if (i > 0 && frame.sequence == last) continue;
    if (i > 0 && frame.cut) return sum / weights;
    if (frame.failed) {
      ++later;
      continue;
    }
    if (!frame.stats) return std::nullopt;
    if (i > 0 && begins_scene(i)) return sum / weights;
    const uint32_t weight = frame.has_mean() ? lookahead_ + 1 - later : 0;
    sum += frame.stats->mean_log2_luminance * weight;
    weights += weight;
    last = frame.sequence;
    ++later;
  }
  // What counts must not depend on when frames arrive, so wait for all of the look-ahead.
  if (later <= lookahead_ && !ended_) return std::nullopt;
  return sum / weights;
}

std::optional<double> ExposureTrack::deciding_mean() const {
  const Waiting& frame = frames_.front();
  // Later frames cannot change an exposure that is given, so nothing waits for them.
  if (frame.given) return frame.stats->metered_mean();
  return frame.has_mean() ? mean_of_first() : std::nullopt;
}

// The target before its limits, of a frame that repeats the last one. A resume token does not hold this
// number, so it is computed again, from this frame's own mean even if look-ahead decided the exposure.
double ExposureTrack::before_limits_again(const Waiting& frame) const {
  const Exposed& exposed = point_.exposed;
  if (exposed.target_before_limits != 0) return exposed.target_before_limits;
  const bool limited =
      exposed.target == frame.settings.min_exposure() || exposed.target == frame.settings.max_exposure();
  if (!limited) return exposed.target;
  return target_before_limits(frame.settings, frame.stats->metered_mean().value_or(kNothingMetered));
}

std::optional<FrameExposure> ExposureTrack::next() {
  while (!frames_.empty() && frames_.front().failed) {
    // The next frame begins the scene that this one was to begin. A repeated frame begins none.
    if (!point_.is_of(frames_.front().sequence)) point_.cut_pending |= frames_.front().cut;
    frames_.pop_front();
  }
  if (frames_.empty() || !frames_.front().stats) return std::nullopt;
  const Waiting& frame = frames_.front();
  if (point_.is_of(frame.sequence)) {
    FrameExposure again{point_.sequence, point_};
    again.point.exposed.target_before_limits = before_limits_again(frame);
    frames_.pop_front();
    return again;
  }
  const std::optional<double> mean = deciding_mean();
  if (frame.has_mean() && !mean) return std::nullopt;
  point_ = after_first(mean);
  frames_.pop_front();
  return FrameExposure{point_.sequence, point_};
}

ExposurePoint ExposureTrack::after_first(std::optional<double> mean) const {
  const Waiting& frame = frames_.front();
  const bool takes_target = mean && (point_.cut_pending || begins_scene(0));
  std::optional<PreviousExposure> previous;
  if (point_.begun && !takes_target) {
    const int64_t elapsed_ns = frame.media_time_ns - point_.media_time_ns;
    previous = {point_.exposed.exposure, static_cast<double>(elapsed_ns) * 1e-9};
  }
  const bool cut = takes_target || frame.cut;
  const Exposed exposed = expose(frame.settings, previous, mean, frame.given);
  CHECK(std::isfinite(exposed.exposure) && exposed.exposure > 0);
  std::optional<ScenePrint> print;
  if (cut_threshold_ev_ > 0.0) print = mean ? frame.stats->print : point_.print;
  return {.begun = true,
          .sequence = frame.sequence,
          .media_time_ns = frame.media_time_ns,
          .exposed = exposed,
          .before = previous && !cut ? previous->exposure : exposed.exposure,
          .cut = cut,
          .cut_pending = !mean && (point_.cut_pending || frame.cut),
          .print = print};
}

}  // namespace candela
