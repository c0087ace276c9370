// The life of a call on the server: its transport, its place in a gate, its idle timer and its one end.
#pragma once

#include <grpcpp/support/byte_buffer.h>
#include <grpcpp/support/status.h>

#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "absl/base/thread_annotations.h"
#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "absl/strings/string_view.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"
#include "server/base/clock.h"
#include "server/rpc/service_state.h"

namespace candela {

// Tells its ServerCall of every event, and never from inside one of these methods. It lives until the call's
// on_done() has returned. Any thread.
class CallTransport {
 public:
  virtual ~CallTransport() = default;

  // One read at a time: on_read_done() follows. So does on_write_done() after a write. The message belongs to
  // the transport until then.
  virtual void start_read(grpc::ByteBuffer* message) = 0;
  virtual void start_write(const grpc::ByteBuffer* message) = 0;
  // Once. on_done() follows when every read and write has ended.
  virtual void finish(const grpc::Status& status) = 0;
  // Drops the connection to the client: on_cancel() follows, unless the call is done.
  virtual void cancel() = 0;

  virtual bool is_cancelled() const = 0;
  // The client's; InfiniteFuture if it has none.
  virtual absl::Time deadline() const = 0;
  // The client's address, as the log names it.
  virtual std::string peer() const = 0;
  // See is_straight_from_this_host().
  virtual bool straight_from_this_host() const { return false; }
  // See client_identity().
  virtual std::string identity(bool tokens) const = 0;
};

// The life of one call: its ownership, its place in a gate, its idle timer and its one end.
//
// Its transport owns a call until on_done. The call gives up its place in the gate when it finishes. It
// leaves the gate in on_done or, if the peer is dead, one idle timeout after it finished. Methods without a
// note may be called from any thread. The mutex is never held for longer than it takes to copy or to
// decompress one band.
class ServerCall : public std::enable_shared_from_this<ServerCall> {
 public:
  virtual ~ServerCall() = default;

  // The transport's events. `ok` says that there is a message, or that it was written.
  virtual void on_read_done(bool ok) = 0;
  virtual void on_write_done(bool ok) = 0;
  void on_cancel() ABSL_LOCKS_EXCLUDED(mutex_);
  // The last one: the call does not use its transport any more.
  void on_done() ABSL_LOCKS_EXCLUDED(mutex_);

  // Calls `then` under the mutex, unless the call has finished.
  void if_running(absl::FunctionRef<void()> then) ABSL_LOCKS_EXCLUDED(mutex_);

  // Does the same after `wait`, unless the timer is destroyed before. Every wait takes a new timer, because
  // one that fired is still in its callback when the next one is set.
  std::unique_ptr<Timer> if_running_after(absl::Duration wait, std::function<void()> then);

 protected:
  // `state` and its `gate` outlive the call.
  ServerCall(CallTransport& transport, ServiceState& state, CallGate& gate);

  // Enters the gate: on_entered() follows, or finish() if the gate refuses.
  void start() ABSL_LOCKS_EXCLUDED(mutex_);

  // Calls on_finish() and the transport's finish(). At most once, and nothing else may be started after it.
  void finish(const absl::Status& status) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  bool finished() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) { return finished_; }
  bool inside() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) { return inside_; }

  // Calls on_idle() after `wait`. Replaces an earlier watch.
  void watch_idle(absl::Duration wait) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::Duration idle_timeout() const { return idle_timeout_; }
  // DEADLINE_EXCEEDED if the upload of `frame`, which began `taken` ago, takes too long. A client that sends
  // one row a minute makes progress, but must not go on for days.
  absl::Status check_upload_time(absl::string_view frame, absl::Duration taken) const;

  virtual void on_entered() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) = 0;
  // The call is still running: watch again, or end it.
  virtual void on_idle() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) = 0;
  // The call ends with `status`: release its memory and jobs. `message` is the error text that the client
  // gets.
  virtual void on_finish(const absl::Status& status, const std::string& message)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) = 0;

  CallTransport& transport_;  // until on_done
  Clock& clock_;
  absl::Mutex mutex_;

 private:
  std::unique_ptr<Timer> call_after(absl::Duration wait, std::function<void()> then);
  void on_timer(uint64_t watch) ABSL_LOCKS_EXCLUDED(mutex_);

  Timers& timers_;
  CallGate& gate_;
  const absl::Duration idle_timeout_;
  bool inside_ ABSL_GUARDED_BY(mutex_) = false;  // the gate, and has not left
  bool finished_ ABSL_GUARDED_BY(mutex_) = false;
  std::unique_ptr<Timer> idle_timer_ ABSL_GUARDED_BY(mutex_);
  uint64_t watch_ ABSL_GUARDED_BY(mutex_) =
      0;  // the number of the timer; 0: none is set, or the call is done
};

}  // namespace candela
