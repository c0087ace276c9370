// The frames of one session, in order, from their headers to their answers.
#pragma once

#include <atomic>
#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"
#include "candela/v1/render.pb.h"
#include "server/schedule/render_loop.h"
#include "server/session/exposure_track.h"
#include "server/session/render_start.h"

namespace candela {

// Holds the stage of each frame, decides exposures, and says which answer is due and which frames are dropped
// when the session ends early. Its caller renders, encodes and sends. A frame goes through these stages, and
// may fail in any of them:
//
//   receiving -> queued -> (waiting -> drawing ->) (encoding ->) done
//
// Only sessions with look-ahead use waiting and drawing: a frame is metered first, and waits until the frames
// that it looks ahead to are metered too. A session that draws nothing uses waiting, too: its frames are done
// once they are decided. One thread at a time, except decide().
class SessionFrames {
 public:
  enum class Stage { kReceiving, kQueued, kWaiting, kDrawing, kEncoding, kDone, kFailed };

  struct Entry {
    // Set by add().
    uint64_t sequence = 0;
    bool cut = false;
    WireLayout layout;
    absl::Time deadline = absl::InfiniteFuture();
    std::string settings_hash;

    // Set by the caller when the frame is admitted.
    std::shared_ptr<Frame> frame;
    absl::Time begun;

    // Set by the methods of SessionFrames.
    Stage stage = Stage::kReceiving;
    // Answered before the session was resumed: it is read, dropped and answered with a failure that says so.
    bool passed_over = false;
    uint64_t token_sequence = 0;  // the frame that its token is after; `sequence` unless it is passed over
    std::atomic<bool> dropped = false;  // left the session before it was answered; `stage` is where it was
    Ticket ticket = 0;                  // of its last job
    bool decided = false;
    ExposurePoint exposure;               // after this frame; valid if decided
    std::vector<StageTime> meter_stages;  // of the separate metering that look-ahead does
    absl::Duration queued = absl::ZeroDuration();
    std::optional<FrameReport> report;
    std::shared_ptr<const std::string> file;  // the encoded image; null for raw images
    absl::Status failure;

    // The render loop has a job for it.
    bool submitted() const { return stage == Stage::kQueued || stage == Stage::kDrawing; }
    // It has no answer yet.
    bool unfinished() const { return stage != Stage::kDone && stage != Stage::kFailed; }
  };
  using EntryPtr = std::shared_ptr<Entry>;
  using Entries = std::vector<EntryPtr>;

  // Continues after `point`. The session has at most `capacity` + `lookahead` frames at a time. Unless
  // `draws`, the frames are metered and their exposure is decided, but there are no images. `resumed_at` is
  // the frame of the token that the session was resumed with, if it was.
  SessionFrames(uint32_t lookahead, double cut_threshold_ev, const ExposurePoint& point, size_t capacity,
                bool draws = true, std::optional<uint64_t> resumed_at = std::nullopt);

  bool empty() const { return frames_.empty(); }
  bool has_room() const { return frames_.size() < capacity_; }
  // The frame that was added last; the session is not empty.
  const EntryPtr& newest() const { return frames_.back(); }
  // Whether any frame is being worked on or has an answer to send.
  bool busy() const;

  // Adds the next frame, whose deadline begins at `now`. Fails as ExposureTrack::add does.
  absl::Status add(const v1::FrameHeader& header, const WireLayout& layout, const v1::Exposure& settings,
                   std::string settings_hash, absl::Time now);
  // Whether a frame of this number is passed over: the session was resumed behind it, and no later frame
  // came.
  bool passes_over(uint64_t sequence) const { return resumed_at_ && sequence < *resumed_at_ && !moved_on_; }
  // Adds a frame that is passed over. `settings_hash` is the resumed session's.
  void add_passed(uint64_t sequence, const WireLayout& layout, std::string settings_hash);
  // All of the frame has arrived.
  static void passed(Entry& entry);
  // No more frames follow. Frames that waited for them may be decided now.
  void close();

  // The work of a frame's first job.
  Work first_work() const { return draws_ && lookahead_ == 0 ? Work::kRender : Work::kMeter; }
  // A job for that work is in the render loop.
  static void submitted(Entry& entry, Work work, Ticket ticket);
  // Decides the exposure of a frame whose job is kRender, between its two phases. Frames of a session are
  // rendered in order, so the frame that is metered is the next to be decided. Returns the default for a
  // frame that was dropped. Any thread: it waits for no work of the others.
  Exposed decide(Entry& entry, const FrameStats& stats);
  // The frame is metered and waits for its exposure.
  void metered(Entry& entry, RenderedFrame metered);
  // The next waiting frame whose exposure is decided, to be submitted with kDraw; null if there is none. If
  // the session draws nothing, the frame is done already.
  EntryPtr next_decided();
  // The frame is rendered, and still has to be encoded if `encode` is set.
  static void rendered(Entry& entry, RenderedFrame rendered, bool encode);
  static void encoded(Entry& entry, std::string file, absl::Duration took);
  // The work on the frame failed. Returns true if only the frame fails: it is answered with `status` and the
  // session goes on. Otherwise nothing changes and the session has to end before this frame.
  bool fail(Entry& entry, const absl::Status& status);

  // Ends the session early. Drops `first` and all frames after it. With look-ahead it also drops the frames
  // from the first undecided one on, because the frames that they wait for will not come. The frames that are
  // left will still be answered. Returns the dropped ones for their jobs and memory to be released.
  Entries end_before(const Entry& first);
  // Does the same for the frame that is being received, if there is one.
  Entries end_after_received();
  Entries drop_all() { return drop_from(0); }

  // The frame whose answer is due, a done or failed one; null if the first frame is still unfinished.
  EntryPtr due() const;
  // The session's exposure after the due frame, for its resume token. Call it once for each frame.
  const ExposurePoint& answer(const Entry& due);
  // The answer has gone out: forgets the frame.
  void pop();
  // The number of frames that were answered.
  uint64_t answered() const { return answered_; }

 private:
  static void finish_undrawn(Entry& entry);
  Entries end_at(size_t first);
  Entries drop_from(size_t first);

  const uint32_t lookahead_;
  const size_t capacity_;
  const bool draws_;
  absl::Mutex track_mutex_;  // held for the track's own steps only, so that the render thread may take it
  ExposureTrack track_ ABSL_GUARDED_BY(track_mutex_);
  std::deque<EntryPtr> frames_;
  ExposurePoint told_;  // after the last frame that was answered
  uint64_t answered_ = 0;
  const std::optional<uint64_t> resumed_at_;
  bool moved_on_ = false;  // a frame after resumed_at_ came
};

}  // namespace candela
