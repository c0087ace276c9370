// A run of many frames through one session: from a source, to a sink.
#pragma once

#include <cstdint>
#include <string>

#include "absl/status/status.h"
#include "absl/time/time.h"
#include "candela/v1/render.pb.h"
#include "client/run/events.h"
#include "client/run/frames/frame_feeder.h"
#include "client/run/frames/frame_source.h"
#include "client/run/images/frame_sink.h"
#include "client/run/options.h"
#include "client/run/report.h"
#include "client/run/run.h"
#include "client/session.h"

namespace candela {

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
