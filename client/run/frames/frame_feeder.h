// Feeds the frames of a source into a session.
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
#include "candela/v1/render.pb.h"
#include "client/run/frames/frame_source.h"
#include "client/session.h"

namespace candela {

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

}  // namespace candela
