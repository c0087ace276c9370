#include "server/alarm_timers.h"

#include <grpcpp/alarm.h>

#include <utility>

#include "absl/time/clock.h"

namespace candela {
namespace {

class AlarmTimer final : public Timer {
 public:
  // gRPC wants a date, and turns it into a length of time at once.
  AlarmTimer(absl::Duration wait, std::function<void()> then) {
    alarm_.Set(absl::ToChronoTime(absl::Now() + wait), [then = std::move(then)](bool expired) {
      if (expired) then();
    });
  }

 private:
  grpc::Alarm alarm_;
};

}  // namespace

std::unique_ptr<Timer> AlarmTimers::call_after(absl::Duration wait, std::function<void()> then) {
  return std::make_unique<AlarmTimer>(wait, std::move(then));
}

}  // namespace candela
