#include "server/session/limits/call_gate.h"

#include "absl/strings/str_format.h"
#include "server/base/check.h"

namespace candela {

absl::Status CallGate::enter() {
  absl::MutexLock lock(&mutex_);
  if (closed_) {
    return absl::UnavailableError(
        absl::StrFormat("server is draining and takes no new %s; use another one", what_));
  }
  if (places_taken_ >= max_calls_) {
    return absl::UnavailableError(
        absl::StrFormat("server has %d %s, which is its limit; try again soon", places_taken_, what_));
  }
  ++places_taken_;
  ++inside_;
  return absl::OkStatus();
}

void CallGate::give_up_place() {
  absl::MutexLock lock(&mutex_);
  CHECK(places_taken_ > 0);
  --places_taken_;
}

void CallGate::leave() {
  absl::MutexLock lock(&mutex_);
  CHECK(inside_ > 0);
  --inside_;
}

void CallGate::close() {
  absl::MutexLock lock(&mutex_);
  closed_ = true;
}

uint32_t CallGate::places_taken() const {
  absl::MutexLock lock(&mutex_);
  return places_taken_;
}

bool CallGate::closed() const {
  absl::MutexLock lock(&mutex_);
  return closed_;
}

bool CallGate::wait_until_empty(absl::Duration timeout) {
  absl::MutexLock lock(&mutex_);
  const auto empty = [this]() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) { return inside_ == 0; };
  return clock_.await(mutex_, absl::Condition(&empty), timeout);
}

}  // namespace candela
