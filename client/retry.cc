#include "client/retry.h"

#include <algorithm>

#include "absl/strings/str_format.h"
#include "absl/time/clock.h"
#include "client/call/retry/retry_info.h"
#include "client/call/retry/retry_schedule.h"

namespace candela {
namespace {

// Waits until `time`. False if `stop` is notified before.
bool wait_until(absl::Time time, const absl::Notification* stop) {
  if (stop != nullptr) return !stop->WaitForNotificationWithDeadline(time);
  absl::SleepFor(time - absl::Now());
  return true;
}

absl::Status gave_up(const absl::Status& refusal, absl::Duration limit) {
  if (limit <= absl::ZeroDuration()) return refusal;
  return absl::UnavailableError(absl::StrFormat("no server takes the call within %s: %s",
                                                absl::FormatDuration(limit), refusal.message()));
}

}  // namespace

std::optional<absl::Duration> retry_after(const absl::Status& status) { return noted_retry_delay(status); }

absl::Status retry(size_t servers, const RetryOptions& options,
                   absl::FunctionRef<absl::Status(size_t server)> attempt) {
  RetrySchedule schedule(servers);
  absl::Status refusal;  // of the last server that was reached
  absl::Time until = absl::InfinitePast();
  while (true) {
    const size_t server = schedule.next();
    const absl::Status status = attempt(server);
    if (!absl::IsUnavailable(status)) return status;
    const std::optional<absl::Duration> delay = retry_after(status);
    if (delay && refusal.ok()) until = std::min(absl::Now() + options.limit, options.deadline);
    if (delay) refusal = status;
    schedule.failed(delay.value_or(absl::ZeroDuration()));
    if (!schedule.round_over()) continue;
    if (refusal.ok()) return status;
    const absl::Time when = schedule.when();
    if (absl::Now() >= until || when >= until) return gave_up(refusal, options.limit);
    if (options.on_wait) options.on_wait(server, refusal, when - absl::Now());
    if (!wait_until(when, options.stop)) return absl::CancelledError("the wait for a server was stopped");
  }
}

}  // namespace candela
