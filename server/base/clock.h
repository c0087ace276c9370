// Time as an input: whatever waits or asks for the time is given a clock, so that tests run in virtual time.
// A sign to stop that can be waited for, and a limit of one a second.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"

namespace candela {

// Any thread.
class Clock {
 public:
  virtual ~Clock() = default;

  // The date. It may be set, also back.
  virtual absl::Time now() = 0;
  // For lengths of time that no change of the date may affect.
  virtual std::chrono::steady_clock::time_point steady() = 0;

  // Waits until `condition` holds, as absl::Mutex::AwaitWithTimeout does. Returns whether it does.
  virtual bool await(absl::Mutex& mutex, const absl::Condition& condition, absl::Duration timeout)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex) = 0;

  void sleep(absl::Duration time);
};

// The machine's own clock.
class RealClock final : public Clock {
 public:
  absl::Time now() override;
  std::chrono::steady_clock::time_point steady() override;
  bool await(absl::Mutex& mutex, const absl::Condition& condition, absl::Duration timeout) override
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex);
};

// A callback that comes later, unless this is destroyed before. Destroying it does not wait for a callback
// that runs.
class Timer {
 public:
  virtual ~Timer() = default;
};

// Any thread. Timers may outlive it.
class Timers {
 public:
  virtual ~Timers() = default;
  // Calls `then` once after `wait`, on any thread, but never from inside this function.
  virtual std::unique_ptr<Timer> call_after(absl::Duration wait, std::function<void()> then) = 0;
};

// Limits events that a stranger can cause without end, such as log lines, to one a second.
//
// Not thread-safe.
class OneASecond {
 public:
  // Counts an event. If it may pass, returns the number of events since the last one that passed, this one
  // included; otherwise nothing.
  std::optional<uint64_t> pass(absl::Time now) {
    ++events_;
    if (now < next_) return std::nullopt;
    next_ = now + absl::Seconds(1);
    return std::exchange(events_, 0);
  }

 private:
  uint64_t events_ = 0;
  absl::Time next_ = absl::InfinitePast();
};

// What tells a thread to end, also while it waits.
//
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
