// What tells a thread to end, also while it waits.
#pragma once

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"
#include "server/base/clock.h"

namespace candela {

// Any thread.
class StopSign {
 public:
  explicit StopSign(Clock& clock) : clock_(clock) {}

  void give() {
    const absl::MutexLock lock(&mutex_);
    given_ = true;
  }
  bool is_given() const {
    const absl::MutexLock lock(&mutex_);
    return given_;
  }
  // Waits for it. Returns whether it came within `timeout`.
  bool comes_within(absl::Duration timeout) {
    const absl::MutexLock lock(&mutex_);
    return clock_.await(mutex_, absl::Condition(&given_), timeout);
  }

 private:
  Clock& clock_;
  mutable absl::Mutex mutex_;
  bool given_ ABSL_GUARDED_BY(mutex_) = false;
};

}  // namespace candela
