// Who is being served: the gate of calls, the table of sessions, the drain, and what a server keeps for all
// sessions.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"
#include "candela/v1/render.pb.h"
#include "server/schedule/render_loop.h"
#include "server/session/client_memory.h"
#include "server/session/resume_token.h"
#include "server/session/stream_start.h"

namespace candela {

// A gate that limits the number of running calls, closes for a drain, and knows when all have left.
//
// Any thread.
class CallGate {
 public:
  // `what` names the calls in messages, in the plural.
  CallGate(std::string what, uint32_t max_calls) : what_(std::move(what)), max_calls_(max_calls) {}

  // On OK the call has a place. It must call give_up_place(), and then leave(). UNAVAILABLE if the gate is
  // full or closed.
  absl::Status enter();
  // Call it when the call's end is decided, before the client hears of it: so the client can enter again at
  // once.
  void give_up_place();
  // Call it when the client has got the end of the call, or never will.
  void leave();

  // From now on enter() fails.
  void close();
  bool closed() const;
  uint32_t places_taken() const;
  // Calls `then` once when no call is inside: at once, or when the last one leaves. The gate is closed.
  void when_empty(std::function<void()> then);

 private:
  const std::string what_;
  const uint32_t max_calls_;
  mutable absl::Mutex mutex_;
  uint32_t places_taken_ ABSL_GUARDED_BY(mutex_) = 0;
  uint32_t inside_ ABSL_GUARDED_BY(mutex_) = 0;  // have not left
  bool closed_ ABSL_GUARDED_BY(mutex_) = false;
  std::function<void()> on_empty_ ABSL_GUARDED_BY(mutex_);
};

// A call that carries a session. Any thread.
class SessionCall {
 public:
  virtual ~SessionCall() = default;

  // The server drains: no more frames are taken, and those that can be answered still are.
  virtual void go_away() = 0;
  // Another call resumed the session: ends at once.
  virtual void give_up() = 0;
};

// A table of the open sessions, by name. Any thread. Never calls a SessionCall.
class SessionTable {
 public:
  // Enters a session for `call`. If another call has the session and this one is `resumed` with an epoch that
  // is not older, returns the other call, which the caller tells to give up; returns null if there is none.
  // ALREADY_EXISTS if another call has the session and this one is not resumed. FAILED_PRECONDITION for an
  // older epoch.
  absl::StatusOr<std::shared_ptr<SessionCall>> enter(const std::string& session, uint64_t epoch, bool resumed,
                                                     std::shared_ptr<SessionCall> call);
  // Does nothing if another call has taken the session over.
  void leave(const std::string& session, const SessionCall* call);

  std::vector<std::shared_ptr<SessionCall>> all() const;

 private:
  struct Entry {
    uint64_t epoch;
    std::weak_ptr<SessionCall> call;
    const SessionCall* key;
  };

  mutable absl::Mutex mutex_;
  std::map<std::string, Entry> sessions_ ABSL_GUARDED_BY(mutex_);
};

// The drain of a server: nobody new comes in, and it ends when those inside have left.
//
// Any thread.
class Drain {
 public:
  using Ended = std::function<void(bool drained)>;

  // Closes the gates and tells the sessions of `table` to go away. Then calls `ended` once: with true when
  // every call has left, which may be before this returns, or with false from on_time(). The gates refer to
  // the drain until their calls have left.
  static std::shared_ptr<Drain> begin(CallGate& calls, CallGate& sessions, const SessionTable& table,
                                      Ended ended);

  // Its time is over: `ended` has been called when this returns.
  void on_time() ABSL_LOCKS_EXCLUDED(mutex_);

 private:
  explicit Drain(Ended ended) : ended_(std::move(ended)) {}
  void on_empty() ABSL_LOCKS_EXCLUDED(mutex_);
  void end(bool drained) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  absl::Mutex mutex_;
  int gates_ ABSL_GUARDED_BY(mutex_) = 2;  // that are not empty
  Ended ended_ ABSL_GUARDED_BY(mutex_);    // null once it was called
};

// The open sessions of a server and the state that they share. Any thread.
struct Sessions {
  const TokenKeys keys;
  const std::shared_ptr<ClientMemory> memory;
  SessionTable table{};
  std::atomic<Flow> next_flow{1};  // odd numbers are sessions, even ones are clients
};

struct OpenedSession {
  StreamStart start;
  uint64_t epoch = 0;  // 0, and one more each time the session is resumed
  bool resumed = false;
  ResumePoint point;  // if not resumed, only its exposure counts: the default, or the state that was given
  // The last frame whose exposure the resumed session knows; none if it is not resumed.
  std::optional<uint64_t> resumed_at() const {
    return resumed && point.exposure.begun ? std::optional(point.exposure.sequence) : std::nullopt;
  }
  std::shared_ptr<SessionCall> previous;  // the call that had this session until now; null if none
};

// Checks the request and its resume token, and enters the session into the table for `call`. Fails as
// stream_start_from, TokenKeys::open and SessionTable::enter do, and with FAILED_PRECONDITION if the settings
// are not those of the token. The caller tells `previous` to give up.
absl::StatusOr<OpenedSession> open_session(const v1::StreamOpen& open, absl::Time now, Sessions& sessions,
                                           std::shared_ptr<SessionCall> call);

}  // namespace candela
