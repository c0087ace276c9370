// A run of frames through one session: a FrameSource gives the frames, a FrameSink takes the images.
#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"
#include "candela/v1/render.pb.h"
#include "client/render_result.h"
#include "client/run/events.h"
#include "client/run/frame_source.h"
#include "client/run/options.h"
#include "client/run/report.h"
#include "client/run/run.h"
#include "client/session.h"

namespace candela {

// Where the images of a run go.
//
// Gets every frame of a run once, in order. Used by one thread.
class FrameSink {
 public:
  virtual ~FrameSink() = default;

  // The frame's image. If it cannot be written, this call or a later one fails.
  virtual absl::Status image(RunFrame frame, RenderResult image) = 0;

  // The frame has no image of its own. If frame.held is set, the image before it, which must exist, is
  // repeated with the same bytes. Otherwise frame.status says why there is none.
  virtual absl::Status none(RunFrame frame) = 0;

  // Waits until all images are where they belong.
  virtual absl::Status finish() = 0;
};

// Feeds the frames of a source into a session.

// Copies from `own` to `settings` what may differ from frame to frame: the alpha, the input's primaries,
// exposure and bloom, which PQ and HLG frames have of their own, and the image's size. False if `settings`
// had the same already.
bool take_input_of(const v1::Settings& own, v1::Settings& settings);

// Takes and submits the frames on its own thread. Other members may be called meanwhile.
class FrameFeeder {
 public:
  // The source must outlive the feeder. `skip_bad`: a frame that the source cannot read does not end the run.
  FrameFeeder(FrameSource& source, bool skip_bad) : source_(source), skip_bad_(skip_bad) {}
  ~FrameFeeder() { join(); }

  // The settings of the first frame that there is, or null if there is none. Call it before start().
  absl::StatusOr<const v1::Settings*> first();

  // `settings` are those that the session was opened with, for the first frame. The session must outlive the
  // thread.
  void start(Session& session, const v1::Settings& settings);
  void join();
  // The source gives no more frames. Any thread.
  void stop() { source_.stop(); }

  // Why the feeder stopped before the last frame. Valid once the session has no more results.
  absl::Status status() const;

  // The facts of the submitted frame with this sequence number. Call it once per frame.
  FrameFacts take_facts(uint64_t sequence);
  // The frames before this sequence number that could not be read, in order, and why. Returns each once.
  std::vector<std::pair<FrameFacts, absl::Status>> take_skipped(uint64_t sequence);
  std::set<std::string> take_notes();

 private:
  absl::Status skip(SourceFrame frame);
  absl::Status feed(Session& session, v1::Settings settings);

  FrameSource& source_;
  const bool skip_bad_;
  std::optional<SourceFrame> next_;
  mutable absl::Mutex mutex_;
  absl::Status status_ ABSL_GUARDED_BY(mutex_);
  std::map<uint64_t, FrameFacts> facts_ ABSL_GUARDED_BY(mutex_);  // frames without a result so far
  std::deque<SourceFrame> skipped_ ABSL_GUARDED_BY(mutex_);
  std::set<std::string> notes_ ABSL_GUARDED_BY(mutex_);
  std::thread thread_;
};

// A run of many frames through one session: from a source, to a sink.
//
// Used by one thread.
class SessionRun {
 public:
  // Both must outlive it.
  SessionRun(const SessionRunOptions& options, RunEvents& events);

  // Prepares the run, and the session's options, which begin with `settings`: those of the user, or a part of
  // them. Checks the tier. Call it before the others.
  absl::Status prepare(v1::Settings settings);

  // The options that the session will be opened with. A frame's own alpha and primaries are set as it comes.
  SessionOptions& session() { return session_; }

  // Opens the session, renders every frame of the source, and hands each on to the sink. Returns when the
  // sink is done with the last one, or with the first failure: of a file, a call, a frame or the sink. With
  // options.skip_bad a frame that cannot be had, or that the server refuses, is none.
  absl::Status render(FrameSource& source, FrameSink& sink);

  Run& run() { return run_; }
  RunSummary& summary() { return summary_; }

 private:
  absl::Status exchange(FrameFeeder& feeder, FrameSink& sink);
  absl::Status take_results(Session& session, FrameFeeder& feeder, FrameSink& sink);
  absl::Status take(FrameResult& result, FrameFacts facts, FrameSink& sink);
  absl::Status take_skipped(FrameFeeder& feeder, uint64_t before, FrameSink& sink);
  absl::Status without_image(RunFrame frame, FrameSink& sink);
  void add_notes_on(const RunFrame& frame);
  void tell_of_resume(const Session& session);

  const SessionRunOptions& options_;
  RunEvents& events_;
  Run run_;
  RunSummary summary_;
  SessionOptions session_;
  RunProgress progress_;
  absl::Time begin_;
  bool said_bad_ = false;
  bool said_gamut_ = false;
  bool said_held_ = false;
};

}  // namespace candela
