// A gate that limits the number of calls and closes when the server drains.
#pragma once

#include <cstdint>
#include <string>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"

namespace candela {

// Any thread.
class CallGate {
 public:
  // `what` names the calls in messages, in the plural.
  CallGate(std::string what, uint32_t max_calls) : what_(std::move(what)), max_calls_(max_calls) {}

  // On OK the caller is inside and must call leave(). UNAVAILABLE if the gate is full or closed.
  absl::Status enter();
  void leave();

  // From now on enter() fails.
  void close();
  bool closed() const;
  uint32_t inside() const;
  // Waits until nobody is inside. Returns false if that takes longer than `timeout`.
  bool wait_until_empty(absl::Duration timeout);

 private:
  const std::string what_;
  const uint32_t max_calls_;
  mutable absl::Mutex mutex_;
  uint32_t calls_ ABSL_GUARDED_BY(mutex_) = 0;
  bool closed_ ABSL_GUARDED_BY(mutex_) = false;
};

}  // namespace candela
