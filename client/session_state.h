// The state of a session: what its callers share with the driver of its calls.
#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"
#include "client/call/stream_reader.h"
#include "client/session.h"
#include "client/session_log.h"
#include "server/base/clock.h"

namespace candela {

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

}  // namespace candela
