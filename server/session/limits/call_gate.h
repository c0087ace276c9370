// A gate that limits the number of running calls, closes for a drain, and knows when all have left.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/synchronization/mutex.h"

namespace candela {

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

}  // namespace candela
