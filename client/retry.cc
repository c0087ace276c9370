#include "client/retry.h"

#include <algorithm>
#include <random>

#include "absl/strings/str_format.h"
#include "client/call/retry_schedule.h"

namespace candela {
namespace {

absl::Status gave_up(const absl::Status& refusal, absl::Duration limit) {
  if (limit <= absl::ZeroDuration()) return refusal;
  return absl::UnavailableError(absl::StrFormat("no server takes the call within %s: %s",
                                                absl::FormatDuration(limit), refusal.message()));
}

}  // namespace

std::optional<absl::Duration> retry_after(const absl::Status& status) { return noted_retry_delay(status); }

absl::Status retry(size_t servers, const RetryOptions& options,
                   absl::FunctionRef<absl::Status(size_t server)> attempt) {
  RealClock clock;
  const auto wait = [&](absl::Duration time) {
    if (options.stop != nullptr) return !options.stop->WaitForNotificationWithTimeout(time);
    clock.sleep(time);
    return true;
  };
  return retry_by(clock, wait, servers, options, attempt);
}

absl::Status retry_by(Clock& clock, absl::FunctionRef<bool(absl::Duration)> wait, size_t servers,
                      const RetryOptions& options, absl::FunctionRef<absl::Status(size_t server)> attempt) {
  RetrySchedule schedule(servers, std::random_device()());
  absl::Status refusal;  // of the last server that was reached
  absl::Time until = absl::InfinitePast();
  while (true) {
    const size_t server = schedule.next();
    const absl::Status status = attempt(server);
    if (!absl::IsUnavailable(status)) return status;
    const std::optional<absl::Duration> delay = retry_after(status);
    // The limit counts from the first refusal: while no server can be reached, there is nothing to wait for.
    if (delay && refusal.ok()) until = std::min(clock.now() + options.limit, options.deadline);
    if (delay) refusal = status;
    schedule.failed(clock.now(), delay.value_or(absl::ZeroDuration()));
    if (!schedule.round_over()) continue;
    if (refusal.ok()) return status;
    const absl::Time when = schedule.when();
    if (clock.now() >= until || when >= until) return gave_up(refusal, options.limit);
    if (options.on_wait) options.on_wait(server, refusal, when - clock.now());
    if (!wait(when - clock.now())) return absl::CancelledError("the wait for a server was stopped");
  }
}

}  // namespace candela
