#include "tests/support/clock.h"

#include <algorithm>
#include <thread>

namespace candela::testing {

class VirtualClock::Alarm final : public Timer {
 public:
  Alarm(std::shared_ptr<Alarms> alarms, std::pair<absl::Duration, uint64_t> key)
      : alarms_(std::move(alarms)), key_(key) {}
  ~Alarm() override {
    std::function<void()> then;  // outlives the lock, because it may hold another timer
    const absl::MutexLock lock(&alarms_->mutex);
    if (auto found = alarms_->all.find(key_); found != alarms_->all.end()) {
      then = std::move(found->second);
      alarms_->all.erase(found);
    }
  }

 private:
  const std::shared_ptr<Alarms> alarms_;
  const std::pair<absl::Duration, uint64_t> key_;
};

std::chrono::steady_clock::time_point VirtualClock::steady() {
  return std::chrono::steady_clock::time_point(absl::ToChronoNanoseconds(passed()));
}

bool VirtualClock::await(absl::Mutex& mutex, const absl::Condition& condition, absl::Duration timeout) {
  if (timeout == absl::InfiniteDuration()) {
    mutex.Await(condition);
    return true;
  }
  if (timeout <= absl::ZeroDuration()) return condition.Eval();
  std::list<Wait>::iterator wait;
  {
    const absl::MutexLock lock(&mutex_);
    wait = waits_.insert(waits_.end(), {mutex, condition, passed() + timeout, *this});
  }
  mutex.Await(absl::Condition(&*wait, &Wait::is_over));
  const absl::MutexLock lock(&mutex_);
  waits_.erase(wait);
  return condition.Eval();
}

std::unique_ptr<Timer> VirtualClock::call_after(absl::Duration wait, std::function<void()> then) {
  const absl::MutexLock lock(&alarms_->mutex);
  const std::pair key{passed() + std::max(wait, absl::ZeroDuration()), alarms_->made++};
  alarms_->all.emplace(key, std::move(then));
  return std::make_unique<Alarm>(alarms_, key);
}

void VirtualClock::advance(absl::Duration time) {
  for (const absl::Duration end = passed() + time;;) {
    const absl::Duration next = next_moment(end);
    nanoseconds_ = absl::ToInt64Nanoseconds(next);
    wake_waiters();
    ring();
    if (next == end) return;
  }
}

void VirtualClock::wait_for_waiters(int count) {
  const absl::MutexLock lock(&mutex_);
  const auto wait = [&]() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    return waits_.size() >= static_cast<size_t>(count);
  };
  mutex_.Await(absl::Condition(&wait));
}

void VirtualClock::wait_for_timers(int count) {
  const absl::MutexLock lock(&alarms_->mutex);
  const auto set = [&]() ABSL_EXCLUSIVE_LOCKS_REQUIRED(alarms_->mutex) {
    return alarms_->all.size() >= static_cast<size_t>(count);
  };
  alarms_->mutex.Await(absl::Condition(&set));
}

void VirtualClock::tick(absl::Duration tick, int ticks, int waiters) {
  for (int i = 0; i < ticks; ++i) {
    wait_for_waiters(waiters);
    advance(tick);
  }
  wait_for_waiters(waiters);
}

absl::Duration VirtualClock::next_moment(absl::Duration end) const {
  absl::Duration next = end;
  {
    const absl::MutexLock lock(&mutex_);
    for (const Wait& wait : waits_) next = std::min(next, wait.until);
  }
  const absl::MutexLock lock(&alarms_->mutex);
  if (!alarms_->all.empty()) next = std::min(next, alarms_->all.begin()->first.first);
  return std::max(next, passed());
}

// The waiters' conditions are evaluated when their mutex is released. Who holds one may be about to wait
// itself, so this tries again instead of waiting with the clock's mutex held.
void VirtualClock::wake_waiters() {
  for (bool all = false; !all; std::this_thread::yield()) {
    const absl::MutexLock lock(&mutex_);
    all = true;
    for (const Wait& wait : waits_) {
      if (passed() < wait.until) continue;
      all = false;
      if (wait.mutex.TryLock()) wait.mutex.Unlock();
    }
  }
}

void VirtualClock::ring() {
  for (;;) {
    std::function<void()> then;
    {
      const absl::MutexLock lock(&alarms_->mutex);
      const auto first = alarms_->all.begin();
      if (first == alarms_->all.end() || first->first.first > passed()) return;
      then = std::move(first->second);
      alarms_->all.erase(first);
    }
    then();
  }
}

}  // namespace candela::testing
