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
  std::function<void()> then;
  {
    absl::MutexLock lock(&mutex_);
    CHECK(inside_ > 0);
    if (--inside_ == 0) then = std::exchange(on_empty_, nullptr);
  }
  if (then) then();
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

void CallGate::when_empty(std::function<void()> then) {
  {
    absl::MutexLock lock(&mutex_);
    CHECK(closed_);
    if (inside_ > 0) {
      on_empty_ = std::move(then);
      return;
    }
  }
  then();
}

}  // namespace candela
