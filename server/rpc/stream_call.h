// One Stream call: a session from its open message to its last result.
#pragma once

#include <grpcpp/alarm.h>
#include <grpcpp/server_context.h>
#include <grpcpp/support/byte_buffer.h>
#include <grpcpp/support/server_callback.h>

#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <string>

#include "absl/base/thread_annotations.h"
#include "absl/status/statusor.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"
#include "server/rpc/backend.h"
#include "server/rpc/band_reader.h"
#include "server/rpc/render_start.h"
#include "server/rpc/result_writer.h"
#include "server/rpc/stream_start.h"
#include "server/session/exposure_track.h"
#include "server/session/session_table.h"
#include "server/session/settings_track.h"

namespace candela {

// Reading and writing go on at the same time, each one message at a time:
//
//   reading:  open -> between -> (choosing ->) memory -> bands -> between ... -> closed
//   a frame:  receiving -> queued -> (waiting -> drawing ->) (encoding ->) done, or failed
//
// `choosing` is for a promise instead of a tier, `waiting` and `drawing` are for look-ahead, `memory` is
// passed at once unless other frames fill the budget. Results go out from the front of `frames_`, in the
// order in which the frames came. The next read is asked for only while there is a place for what it may
// bring, so that HTTP/2's flow control holds the client back. gRPC's threads call the reactions, the render
// thread and the encoders' what ends a frame's stage, a timer's thread the rest; the mutex is held for a
// band's memcpy at most.
class StreamCall final : public grpc::ServerBidiReactor<grpc::ByteBuffer, grpc::ByteBuffer>,
                         public SessionCall,
                         public std::enable_shared_from_this<StreamCall> {
 public:
  // Owns itself until gRPC is done with it. `backend` outlives it.
  static StreamCall* begin(grpc::CallbackServerContext* context, Backend& backend);

  void OnReadDone(bool ok) override;
  void OnWriteDone(bool ok) override;
  void OnCancel() override;
  void OnDone() override;

  void go_away() override;
  void give_up() override;

 private:
  enum class Reading { kOpen, kBetween, kChoosing, kMemory, kBands, kClosed };
  enum class Stage { kReceiving, kQueued, kWaiting, kDrawing, kEncoding, kDone, kFailed };

  // One frame, from its header to the last message of its result.
  struct SessionFrame {
    uint64_t sequence = 0;
    bool cut = false;
    FrameLayout layout;
    absl::Time begun;
    absl::Time deadline = absl::InfiniteFuture();
    std::string settings_hash;
    std::string tier;  // chosen for a promise
    std::string tier_reason;
    Stage stage = Stage::kReceiving;
    std::shared_ptr<Frame> frame;
    Ticket ticket = 0;
    bool decided = false;
    ExposureState exposure;               // after this frame, once it is decided
    std::vector<StageTime> meter_stages;  // of look-ahead's first half
    absl::Duration queued = absl::ZeroDuration();
    std::optional<FrameReport> report;
    std::shared_ptr<const std::string> file;  // encoded
    absl::Status failure;
    std::optional<ResultWriter> writer;
  };
  using FramePtr = std::shared_ptr<SessionFrame>;

  StreamCall(grpc::CallbackServerContext* context, Backend& backend);

  void enter() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  // Reading.
  absl::Status take_message(grpc::ByteBuffer& message) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::Status take_open(grpc::ByteBuffer& message) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::Status take_between(grpc::ByteBuffer& message) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::Status take_header(const v1::FrameHeader& header) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::Status ask_for_tier() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void choose_tier();
  absl::Status admit() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::Status promise_lookahead(const FrameMemory& memory) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void retry();
  absl::Status take_band(grpc::ByteBuffer& message) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::Status half_closed() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void read_on() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  // Rendering.
  absl::Status submit(const FramePtr& frame, Work work) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::Status submit_decided() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  Exposed expose(const FramePtr& frame, const FrameStats& stats);
  void on_worked(const FramePtr& frame, Work work, absl::StatusOr<RenderedFrame> rendered);
  void on_encoded(const FramePtr& frame, absl::StatusOr<std::string> file, absl::Duration took);
  void finish_frame(const FramePtr& frame) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  // Writing.
  void write_on() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  bool next_message() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  grpc::ByteBuffer header_message(const SessionFrame& frame) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  grpc::ByteBuffer failure_message(const SessionFrame& frame) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  std::string token(const SessionFrame& frame) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  // Nothing more is read. Frames that came whole get their results, where they do not wait for later ones;
  // then the call ends with `status`.
  void read_no_more(const absl::Status& status) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  // No frame from `first` on gets a result, nor one that look-ahead holds back, for what it waits for does
  // not come any more. What is before still does, then the call ends with `status`.
  void end_before(size_t first, const absl::Status& status) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void drop(const FramePtr& frame) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void finish(const absl::Status& status) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  void watch_idle(absl::Duration wait) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void on_idle();
  bool plain() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) { return start_->lookahead == 0; }
  size_t capacity() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  grpc::CallbackServerContext& context_;
  Backend& backend_;
  const Flow flow_;
  std::shared_ptr<StreamCall> self_;  // until OnDone

  absl::Mutex mutex_;
  bool inside_ ABSL_GUARDED_BY(mutex_) = false;    // the gate
  bool finished_ ABSL_GUARDED_BY(mutex_) = false;  // Finish was called
  grpc::ByteBuffer incoming_;                      // gRPC's between StartRead and OnReadDone
  grpc::ByteBuffer outgoing_;                      // gRPC's between StartWrite and OnWriteDone
  Reading state_ ABSL_GUARDED_BY(mutex_) = Reading::kOpen;
  bool reading_ ABSL_GUARDED_BY(mutex_) = false;  // a read is under way
  bool writing_ ABSL_GUARDED_BY(mutex_) = false;  // a write is

  std::optional<StreamStart> start_ ABSL_GUARDED_BY(mutex_);
  uint64_t epoch_ ABSL_GUARDED_BY(mutex_) = 0;
  std::optional<SettingsTrack> settings_ ABSL_GUARDED_BY(mutex_);
  std::optional<ExposureTrack> track_ ABSL_GUARDED_BY(mutex_);
  std::deque<FramePtr> frames_ ABSL_GUARDED_BY(mutex_);  // in the order of their headers
  std::optional<BandReader> bands_ ABSL_GUARDED_BY(mutex_);
  absl::Time memory_deadline_ ABSL_GUARDED_BY(mutex_);
  uint64_t promised_bytes_ ABSL_GUARDED_BY(mutex_) = 0;  // of LookaheadMemory

  std::deque<grpc::ByteBuffer> notices_ ABSL_GUARDED_BY(mutex_);  // before the next result
  ExposureState told_ ABSL_GUARDED_BY(mutex_);                  // after the last frame whose answer went out
  std::optional<absl::Status> ending_ ABSL_GUARDED_BY(mutex_);  // once frames_ is empty
  uint64_t answered_ ABSL_GUARDED_BY(mutex_) = 0;

  absl::Time last_read_ ABSL_GUARDED_BY(mutex_);
  absl::Time last_write_ ABSL_GUARDED_BY(mutex_);
  std::unique_ptr<grpc::Alarm> idle_alarm_ ABSL_GUARDED_BY(mutex_);
  std::unique_ptr<grpc::Alarm> memory_alarm_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace candela
