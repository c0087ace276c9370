// Time as an input: whatever waits or asks for the time is given a clock, so that tests run in virtual time.
#pragma once

#include <chrono>
#include <functional>
#include <memory>

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

}  // namespace candela
