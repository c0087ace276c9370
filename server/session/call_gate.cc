#include "server/session/call_gate.h"

#include "absl/strings/str_format.h"

namespace candela {

absl::Status CallGate::enter() {
  absl::MutexLock lock(&mutex_);
  if (closed_) {
    return absl::UnavailableError(
        absl::StrFormat("server is draining and takes no new %s; use another one", what_));
  }
  if (calls_ >= max_calls_) {
    return absl::UnavailableError(
        absl::StrFormat("server has %d %s, which is its limit; try again soon", calls_, what_));
  }
  ++calls_;
  return absl::OkStatus();
}

void CallGate::leave() {
  absl::MutexLock lock(&mutex_);
  --calls_;
}

void CallGate::close() {
  absl::MutexLock lock(&mutex_);
  closed_ = true;
}

uint32_t CallGate::inside() const {
  absl::MutexLock lock(&mutex_);
  return calls_;
}

bool CallGate::closed() const {
  absl::MutexLock lock(&mutex_);
  return closed_;
}

bool CallGate::wait_until_empty(absl::Duration timeout) {
  absl::MutexLock lock(&mutex_);
  const auto empty = [this]() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) { return calls_ == 0; };
  return mutex_.AwaitWithTimeout(absl::Condition(&empty), timeout);
}

}  // namespace candela
