// Feeds the files of a sequence into a session.
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

// The media time at which frame `index` is shown; 0 for the first.
int64_t media_time_ns(uint64_t index, double fps);

// Facts about an input file that its output file needs.
struct FrameFacts {
  bool has_alpha = false;
  double pixel_aspect = 1;
};

// Reads and submits the files on its own thread. Other members may be called meanwhile.
class FrameFeeder {
 public:
  // `options` and `reader` must outlive the feeder.
  FrameFeeder(const StreamOptions& options, FrameReader& reader) : options_(options), reader_(reader) {}
  ~FrameFeeder() { join(); }

  // The first frame that can be read, or null if there is none. Call it before start().
  absl::StatusOr<const Image*> first();

  // `settings` are those that the session was opened with, for the
  // first frame. The session must outlive the thread.
  void start(Session& session, const v1::Settings& settings);
  void join();

  // Why the feeder stopped before the last file. Valid once the session has no more results.
  absl::Status status() const;

  // The facts of a submitted frame. Call it once per frame.
  FrameFacts take_facts(uint64_t index);
  // The files before `index` that were skipped and not returned yet.
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
  std::map<uint64_t, FrameFacts> facts_ ABSL_GUARDED_BY(mutex_);  // frames without a result so far
  std::deque<std::pair<uint64_t, absl::Status>> skipped_ ABSL_GUARDED_BY(mutex_);
  std::set<std::string> notes_ ABSL_GUARDED_BY(mutex_);
  std::thread thread_;
};

}  // namespace candela
