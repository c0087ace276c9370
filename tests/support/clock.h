// Clocks for tests: the machine's, and one that stands still until it is moved.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <list>
#include <map>
#include <memory>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"
#include "server/base/clock.h"

namespace candela::testing {

// The machine's clock, for tests that take real time.

inline RealClock& real_clock() {
  static RealClock clock;
  return clock;
}

// A clock that stands still until a test moves it.
//
// Any thread may wait and set timers; one thread moves it. The timers end with it.
class VirtualClock final : public Clock, public Timers {
 public:
  absl::Time now() override { return absl::UnixEpoch() + kBegin + passed(); }
  std::chrono::steady_clock::time_point steady() override;
  bool await(absl::Mutex& mutex, const absl::Condition& condition, absl::Duration timeout) override
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex);
  std::unique_ptr<Timer> call_after(absl::Duration wait, std::function<void()> then) override;

  // Goes from one moment at which a wait or a timer is due to the next. Runs the timers itself, and goes on
  // when every wait that is due has returned. Hold no mutex that others need to return from a wait.
  void advance(absl::Duration time);
  // Waits in real time until `count` threads wait for this clock, without a limit.
  void wait_for_waiters(int count);
  // The same for timers that are set.
  void wait_for_timers(int count);
  // wait_for_waiters() and advance(), for `ticks` times `tick`: what the waiter does in each of them is done
  // when it waits again.
  void tick(absl::Duration tick, int ticks = 1, int waiters = 1);

 private:
  static constexpr absl::Duration kBegin = absl::Seconds(1'600'000'000);  // since 1970

  struct Wait {
    absl::Mutex& mutex;
    const absl::Condition& condition;
    const absl::Duration until;  // in time that has passed
    VirtualClock& clock;
    bool is_over() const { return condition.Eval() || clock.passed() >= until; }
  };
  struct Alarms {
    absl::Mutex mutex;
    uint64_t made ABSL_GUARDED_BY(mutex) = 0;
    // By the moment in time that has passed, and those of one moment in the order in which they were made.
    std::map<std::pair<absl::Duration, uint64_t>, std::function<void()>> all ABSL_GUARDED_BY(mutex);
  };
  class Alarm;

  absl::Duration passed() const { return absl::Nanoseconds(nanoseconds_.load()); }
  absl::Duration next_moment(absl::Duration end) const ABSL_LOCKS_EXCLUDED(mutex_);
  void wake_waiters() ABSL_LOCKS_EXCLUDED(mutex_);
  void ring() ABSL_LOCKS_EXCLUDED(mutex_);

  std::atomic<int64_t> nanoseconds_ = 0;
  mutable absl::Mutex mutex_;
  std::list<Wait> waits_ ABSL_GUARDED_BY(mutex_);  // finite ones
  const std::shared_ptr<Alarms> alarms_ = std::make_shared<Alarms>();
};

}  // namespace candela::testing
