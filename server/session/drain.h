// The drain of a server: nobody new comes in, and it ends when those inside have left.
#pragma once

#include <functional>
#include <memory>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"
#include "server/session/limits/call_gate.h"
#include "server/session/session_table.h"

namespace candela {

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

}  // namespace candela
