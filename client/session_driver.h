// A session on the client, without threads: the log of what has no result yet, the state that calls share,
// and the driver of calls.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"
#include "client/call/client_call.h"
#include "client/call/link_pace.h"
#include "client/call/result_reader.h"
#include "client/call/retry_schedule.h"
#include "client/call/shared_memory.h"
#include "client/session.h"
#include "proto/candela/v1/band_wire.h"
#include "proto/candela/v1/image_size.h"
#include "server/base/clock.h"

namespace candela {

// The log of a session: the submitted frames and settings changes that have no result yet. With the last
// resume token it is enough to continue the session on any server.

// One step of a session: a frame or a change of settings.
struct SessionStep {
  std::shared_ptr<const SessionFrame> frame;  // null: a change
  absl::Time submitted;                       // when the frame was submitted
  v1::ImageSize image;                        // of the frame, as its settings ask for
  uint64_t from_sequence = 0;                 // first frame of the change
  v1::Settings settings;                      // settings of the change
  uint64_t image_bytes = 0;                   // of the frame's image; 0: it does not come as pixels
};

// Not thread-safe.
class SessionLog {
 public:
  // `state`, if there is one, is that of the frame before the first.
  // `raw`: images come as pixels.
  explicit SessionLog(v1::Settings settings, const std::optional<v1::SessionState>& state = std::nullopt,
                      bool raw = true);

  // Add a step. They fail like Session::submit() and Session::change_settings().
  absl::Status add(SessionFrame frame, absl::Time now);
  absl::Status change(uint64_t from_sequence, const v1::Settings& settings);

  // The contents of a call's open message: the last token, or empty, and the settings at that point.
  const std::string& token() const { return token_; }
  const v1::Settings& settings() const { return settings_; }

  // A call begins, and every step in the log is to be sent on it. Returns how many frames earlier calls had
  // sent.
  uint64_t rewind();

  // The next step to send, in order, or null if all have been sent. The step stays in the log.
  const SessionStep* next();

  // The frame whose result is due: the first in the log, if it has been sent. Null if no result is due.
  const SessionStep* due() const;

  // The due frame has its result, which came with `token`, or empty without one. The frame leaves the log,
  // and so do the changes that the token covers.
  void answered(const std::string& token);

  // Of the image of a frame of this size that is added next; 0 if it does not come as pixels.
  uint64_t image_bytes(v1::ImageSize frame) const;

  uint64_t unanswered() const { return unanswered_; }

  // The panoramas of the views that have no result yet, by the ids of their environments.
  std::map<std::string, std::shared_ptr<const Panorama>> panoramas() const;

 private:
  std::deque<SessionStep>::const_iterator first_frame() const;
  // Of the frame after all steps.
  const v1::Settings& settings_of(uint64_t sequence) const;
  uint64_t image_bytes(const v1::Settings& settings, v1::ImageSize image) const;

  const bool raw_;
  v1::Settings settings_;
  std::string token_;
  std::deque<SessionStep> steps_;
  size_t given_ = 0;                       // steps at the front that were sent on this call
  uint64_t unanswered_ = 0;                // frames in steps_
  std::optional<uint64_t> last_sequence_;  // of the last frame submitted
  int64_t last_time_ns_ = 0;
  uint64_t last_from_ = 0;  // of the last change
};

// The state of a session: what its callers share with the driver of its calls.
//
// Any thread.
class SessionState {
 public:
  // `server` is the address of the first server. `clock` outlives this object. `wake` is called when the
  // callers have done something that the driver may have to act on: it gets CallEvent::kWoken then. It must
  // not call back.
  SessionState(const SessionOptions& options, std::string server, Clock& clock, std::function<void()> wake);

  // Methods for the callers; see Session.
  absl::Status wait_until_open() const;
  absl::Status submit(SessionFrame frame);
  bool ready() const;
  absl::Status change_settings(uint64_t from_sequence, const v1::Settings& settings);
  void finish();
  void cancel();
  absl::StatusOr<std::optional<FrameResult>> next_result();
  // Whether next_result() would return without waiting.
  bool result_ready() const;
  SessionStats stats() const;
  // See SessionLog.
  uint64_t image_bytes(v1::ImageSize frame) const;

  // All that follows is for the driver.

  // Whether a call to a server is needed. A session that is not open yet needs one. A session that lost its
  // server while no result was due needs none until it has something to send, however long that takes.
  // `idle`: the last answer was kNotYet.
  enum class Need { kNotYet, kCall, kOver };
  Need need(bool idle);

  // A call to `server` begins, and every step that is left is to be sent on it. None if the session is
  // cancelled already.
  struct Start {
    std::string token;  // to resume from; empty: a new session
    v1::Settings settings;
  };
  std::optional<Start> begin_call(const std::string& server);

  // The next step to send. Without a step, `finished` says that none will come.
  struct NextStep {
    std::optional<SessionStep> step = std::nullopt;
    bool finished = false;
  };
  NextStep next_step();

  DueFrame due_frame() const;

  // The server has opened the session. Returns whether no frame waits for a result.
  bool take_open(const v1::StreamOpened& opened);
  // The due frame has its result.
  void take_answer(FrameAnswer answer);

  // See SessionLog.
  std::map<std::string, std::shared_ptr<const Panorama>> panoramas() const;

  bool cancelled() const;
  bool was_open() const;
  // Whether finish() was called and every frame has its result.
  bool complete() const;

  // The session lost its server because of `status`. Returns since when there have been no results.
  absl::Time lose(const absl::Status& status);
  // The session ends with `status`, or with CANCELLED if it was cancelled.
  void end(const absl::Status& status);

 private:
  bool needs_server() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  bool may_submit() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::Status still_taking() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void found_again() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  const uint32_t lookahead_;
  Clock& clock_;
  const std::function<void()> wake_;

  mutable absl::Mutex mutex_;
  SessionLog log_ ABSL_GUARDED_BY(mutex_);
  std::deque<FrameResult> results_ ABSL_GUARDED_BY(mutex_);  // not returned yet
  uint32_t window_ ABSL_GUARDED_BY(mutex_) = 0;
  uint64_t submitted_ ABSL_GUARDED_BY(mutex_) = 0;
  uint64_t sent_before_ ABSL_GUARDED_BY(mutex_) = 0;  // frames in the log that earlier calls sent
  bool was_open_ ABSL_GUARDED_BY(mutex_) = false;
  std::string bits_ ABSL_GUARDED_BY(mutex_);  // of the last server that said them
  bool finished_ ABSL_GUARDED_BY(mutex_) = false;
  bool cancelled_ ABSL_GUARDED_BY(mutex_) = false;
  bool ended_ ABSL_GUARDED_BY(mutex_) = false;
  absl::Status end_ ABSL_GUARDED_BY(mutex_);
  std::optional<absl::Time> lost_ ABSL_GUARDED_BY(mutex_);  // there have been no results since
  SessionStats stats_ ABSL_GUARDED_BY(mutex_);
};

// One Stream call of a session, from its open message to its end.

// The end of a call.
struct CallEnd {
  absl::Status status;  // OK: every frame has its result and the session is over
  bool resume = false;  // another call may continue the session
  absl::Duration retry_delay = absl::ZeroDuration();  // how long the server wants to be left alone
  bool progress = false;                              // a result came, or none was due
  bool reached = false;                               // the server, or a proxy before it, took the call
  bool asked = false;                                 // the server may have opened the session
};

// Sends the session's steps to a server and gives the results to `state`. Used by one thread, and never
// waits. The references must outlive it.
class SessionStream {
 public:
  // `call` has just begun, at the server with this `address`. `asked_before`: CallEnd.asked of an earlier
  // call.
  SessionStream(std::unique_ptr<ClientCall> call, const std::string& address, bool asked_before,
                SessionState::Start start, const SessionOptions& options, const std::string& name,
                SessionState& state, SessionMemory& memory, Clock& clock);

  // Takes the next event, up to kEnded.
  void on_event(CallEvent event);
  // When kTimeout is due.
  absl::Time deadline() const;
  // After kEnded: how the call ended.
  CallEnd end() const;

 private:
  v1::StreamRequest open_message(SessionState::Start start, const std::string& name) const;
  absl::Status take_event(CallEvent event);
  absl::Status take_message();
  absl::Time silent_until() const;
  absl::Status hangs() const;
  CallEnd how_it_ended() const;
  void send_next();
  void send_step();
  bool place(const SessionStep& step, v1::FrameHeader& header);
  DueFrame due_frame() const;
  void send_band();
  grpc::ByteBuffer next_band();

  const std::unique_ptr<ClientCall> call_;
  const std::string& address_;
  const SessionOptions& options_;
  SessionState& state_;
  SessionMemory& memory_;
  Clock& clock_;
  StreamReader reader_;
  const bool asked_before_;
  const v1::StreamRequest open_request_;
  const absl::Time open_by_;                     // when to leave a server that has not opened the session
  bool asked_ = false;                           // the open message is out
  bool open_ = false;                            // the server has opened the session
  bool leaving_ = false;                         // the server goes away, so nothing more is sent
  bool closed_ = false;                          // half-closed
  bool answered_ = false;                        // a result came
  bool progress_ = false;                        // see CallEnd
  std::shared_ptr<const SessionFrame> sending_;  // the frame whose bands are being sent
  uint64_t row_ = 0;                             // first row of its next band
  uint64_t band_ = 0;                            // the number of its next band
  absl::Time band_began_;                        // when the one before it was written
  bool server_unpacks_ = false;                  // the server takes compressed bands
  bool compress_ = false;                        // those of this frame
  LinkPace pace_;
  std::optional<v1::RowPacker> packer_;                         // from the first frame on that is compressed
  std::deque<std::pair<uint64_t, SharedRegion::Area>> images_;  // of frames that were sent, by their numbers
  bool shared_ = false;                                         // a frame was placed in memory
  int64_t owed_ = 0;          // frames that were sent whole and have no result
  absl::Time last_progress_;  // when a message came, or a write began or ended
  CallEnd own_;               // why this side ended the call; OK: it has not
};

// Makes one call of a session after another, until it ends.
//
// Used by one thread, and never waits: events go in, calls of `servers` come out, and `state` gets results
// and the end. The arguments must outlive it.
class SessionDriver {
 public:
  // `seed` is the chance in its pauses.
  SessionDriver(SessionServers& servers, const SessionOptions& options, const std::string& name,
                SessionState& state, SessionMemory& memory, Clock& clock, uint32_t seed);

  void start();  // first of all
  // An event of the call that it has, kTimeout at the deadline, or kWoken after SessionState's wake. Nothing
  // after the end.
  void on_event(CallEvent event);
  // The answer to SessionServers::put().
  void on_put(const absl::StatusOr<v1::Environment>& put);

  absl::Time deadline() const;
  bool ended() const { return phase_ == Phase::kEnded; }

 private:
  enum class Phase {
    kIdle,     // no call is needed
    kCalling,  // there is stream_
    kPutting,  // a server is given the panoramas of unput_, the first one now
    kPausing,  // until pause_until_
    kEnded,
  };
  void next_call();
  void end_call();
  bool put_next();
  void call_failed();
  void pause_after_loss();
  void pause_before_open();
  void end_pause();
  void end(const absl::Status& status);

  SessionServers& servers_;
  const SessionOptions& options_;
  const std::string& name_;
  SessionState& state_;
  SessionMemory& memory_;
  Clock& clock_;
  RetrySchedule schedule_;
  Phase phase_ = Phase::kIdle;
  size_t server_ = 0;  // of the current or the last call
  std::unique_ptr<SessionStream> stream_;
  CallEnd last_;          // of the last call
  bool asked_ = false;    // CallEnd.asked of any call
  absl::Status refusal_;  // of the last server that was reached and has not opened the session
  absl::Time open_by_;    // when the first open is given up, once a server was reached
  absl::Time pause_until_;
  absl::Time pause_limit_ = absl::InfiniteFuture();  // when an open session is given up
  std::map<std::string, std::shared_ptr<const Panorama>> unput_;
  std::set<std::string> put_;  // environments that server_ was given since the last call that it answered
};

}  // namespace candela
