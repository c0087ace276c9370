#include "server/base/clock.h"

#include "absl/time/clock.h"

namespace candela {

void Clock::sleep(absl::Duration time) {
  absl::Mutex mutex;
  const absl::MutexLock lock(&mutex);
  const auto never = [] { return false; };
  await(mutex, absl::Condition(&never), time);
}

absl::Time RealClock::now() { return absl::Now(); }

std::chrono::steady_clock::time_point RealClock::steady() { return std::chrono::steady_clock::now(); }

bool RealClock::await(absl::Mutex& mutex, const absl::Condition& condition, absl::Duration timeout) {
  return mutex.AwaitWithTimeout(condition, timeout);
}

}  // namespace candela
