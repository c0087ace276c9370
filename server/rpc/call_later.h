// A call's timer.
#pragma once

#include <grpcpp/alarm.h>

#include <memory>

#include "absl/time/clock.h"
#include "absl/time/time.h"

namespace candela {

// Calls `then` on a thread of gRPC's after `wait`, unless the alarm was destroyed or the call has gone by
// then. Each wait takes a fresh alarm: one that has fired is still inside its callback when it would be set
// again.
template <typename Call>
std::unique_ptr<grpc::Alarm> call_later(absl::Duration wait, std::weak_ptr<Call> call, void (Call::*then)()) {
  auto alarm = std::make_unique<grpc::Alarm>();
  alarm->Set(absl::ToChronoTime(absl::Now() + wait), [call = std::move(call), then](bool expired) {
    if (!expired) return;
    if (const std::shared_ptr<Call> alive = call.lock()) (alive.get()->*then)();
  });
  return alarm;
}

}  // namespace candela
