// Feeds the files of a sequence into a session.
#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <memory>
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
#include "client/cli/files/exposure_file.h"
#include "client/cli/files/primaries_used.h"
#include "client/cli/files/sequence/frame_files.h"
#include "client/cli/files/sequence/frame_reader.h"
#include "client/cli/files/sequence/sequence.h"
#include "client/image/image.h"
#include "client/session.h"

namespace candela {

// Facts about an input file that its output file needs.
struct FrameFacts {
  bool has_alpha = false;
  double pixel_aspect = 1;
  std::optional<FrameRate> frame_rate;  // if the user gave it or a file says it
  PrimariesUsed primaries;
  std::shared_ptr<const KeptAttributes> kept;  // as in Image
  uint64_t missing_pixels = 0;                 // as in Image
};

// The options that concern the frames to send.
struct FeedOptions {
  v1::Settings settings;
  absl::Duration timeout = absl::InfiniteDuration();  // of a frame on the server
  bool skip_bad = false;                              // files that cannot be read do not end it
  std::optional<FrameRate> rate;                      // --fps
  std::shared_ptr<const BakedView> view;              // of --ocio; null without it
  bool ignore_empty_alpha = false;                    // as in PictureOptions
  GivenExposures exposures;                           // of the frames, by their numbers
};

// Reads and submits the files on its own thread. Other members may be called meanwhile. A frame's `index` is
// its place in the sequence's list; its sequence number in the session goes by its own number.
class FrameFeeder {
 public:
  // `reader` reads the sequence's files. It and the sequence must outlive the feeder.
  FrameFeeder(const Sequence& sequence, FeedOptions options, FrameReader& reader)
      : sequence_(sequence),
        options_(std::move(options)),
        reader_(reader),
        rate_(choose_rate(options_.rate, std::nullopt)) {}
  ~FrameFeeder() { join(); }

  // The first frame that can be read, or null if there is none. Call it before start(). Fails, too, if the
  // last frame's media time is too large.
  absl::StatusOr<const Image*> first();

  // Valid after first(). The first file that can be read may say it; it may come before the first frame.
  const ChosenRate& rate() const { return rate_; }
  // The same; nothing if it is only the default.
  const std::optional<FrameRate>& said_rate() const { return said_rate_; }

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
  SessionFrame frame(uint64_t index, Image read, std::optional<double> exposure);
  absl::Status begin_with(const Image& first);
  void decide_rate(const Image* first);
  // Notes, once each, that frames have another size or another rate than the first.
  std::vector<std::string> differences(uint64_t index, const Image& image);

  const Sequence& sequence_;
  const FeedOptions options_;
  FrameReader& reader_;
  ChosenRate rate_;
  std::optional<FrameRate> said_rate_;  // nothing if rate_ is the default
  bool begins_scene_ = false;  // a frame that was to begin a scene was skipped, so the next one begins it
  std::optional<FrameReader::Read> next_;
  // The first frame that could be read.
  uint64_t first_index_ = 0;
  uint32_t first_width_ = 0, first_height_ = 0;
  bool size_differs_ = false, rate_differs_ = false;
  mutable absl::Mutex mutex_;
  absl::Status status_ ABSL_GUARDED_BY(mutex_);
  std::map<uint64_t, FrameFacts> facts_ ABSL_GUARDED_BY(mutex_);  // frames without a result so far
  std::deque<std::pair<uint64_t, absl::Status>> skipped_ ABSL_GUARDED_BY(mutex_);
  std::set<std::string> notes_ ABSL_GUARDED_BY(mutex_);
  std::thread thread_;
};

}  // namespace candela
