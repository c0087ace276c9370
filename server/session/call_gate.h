// Counts the calls inside, lets no more in than it may, and closes when the server drains.
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
  // `what` it counts, in the plural, for its messages.
  CallGate(std::string what, uint32_t max_calls) : what_(std::move(what)), max_calls_(max_calls) {}

  // OK: in, and leave() is owed. UNAVAILABLE when it is full or closed.
  absl::Status enter();
  void leave();

  // From now on enter() fails.
  void close();
  bool closed() const;
  uint32_t inside() const;
  // Waits until nobody is inside; false when that took longer than `timeout`.
  bool wait_until_empty(absl::Duration timeout);

 private:
  const std::string what_;
  const uint32_t max_calls_;
  mutable absl::Mutex mutex_;
  uint32_t calls_ ABSL_GUARDED_BY(mutex_) = 0;
  bool closed_ ABSL_GUARDED_BY(mutex_) = false;
};

}  // namespace candela
