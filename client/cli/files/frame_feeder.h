// The files of a sequence on their way into a session.
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
#include "client/cli/files/frame_reader.h"
#include "client/cli/options/options.h"
#include "client/image/image.h"
#include "client/session.h"

namespace candela {

// When frame `index` is shown, from the first one on.
int64_t media_time_ns(uint64_t index, double fps);

// What the image's file needs to know of the frame's.
struct FrameFacts {
  bool has_alpha = false;
  double pixel_aspect = 1;
};

// Reads the files and submits them, on a thread of its own. Other members may be called meanwhile.
class FrameFeeder {
 public:
  // Both outlive it.
  FrameFeeder(const StreamOptions& options, FrameReader& reader) : options_(options), reader_(reader) {}
  ~FrameFeeder() { join(); }

  // The first frame that can be read; before start(). None when there is none.
  absl::StatusOr<const Image*> first();

  // `settings` are those the session was opened with, for the first frame. The session outlives the thread.
  void start(Session& session, const v1::Settings& settings);
  void join();

  // Why it stopped before the last file; known once the session has no more results.
  absl::Status status() const;

  // Of a frame that was submitted, once.
  FrameFacts take_facts(uint64_t index);
  // The files before `index` that were skipped and not given out yet.
  std::vector<std::pair<uint64_t, absl::Status>> take_skipped(uint64_t index);
  std::set<std::string> take_notes();

 private:
  absl::Status bad_file(uint64_t index, const absl::Status& status);
  absl::Status feed(Session& session, v1::Settings settings);
  SessionFrame frame(uint64_t index, Image read);

  const StreamOptions& options_;
  FrameReader& reader_;
  std::optional<FrameReader::Read> next_;
  mutable absl::Mutex mutex_;
  absl::Status status_ ABSL_GUARDED_BY(mutex_);
  std::map<uint64_t, FrameFacts> facts_ ABSL_GUARDED_BY(mutex_);  // of frames without a result
  std::deque<std::pair<uint64_t, absl::Status>> skipped_ ABSL_GUARDED_BY(mutex_);
  std::set<std::string> notes_ ABSL_GUARDED_BY(mutex_);
  std::thread thread_;
};

}  // namespace candela
