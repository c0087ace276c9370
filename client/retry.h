// Repeats single calls that a busy server refuses, or that are lost with it. Sessions do so by themselves.
//
//   absl::StatusOr<candela::RenderResult> image;
//   const absl::Status status = candela::retry(1, {}, [&](size_t) {
//     image = server->render(settings, frame);
//     return image.status();
//   });
#pragma once

#include <cstddef>
#include <functional>
#include <optional>

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "absl/synchronization/notification.h"
#include "absl/time/time.h"

namespace candela {

// The wait that a server asks for before the same call is made again; 0 if it does not say. Nothing
// for other errors, also for a server that cannot be reached. Takes a status of a Connection.
//
// UNAVAILABLE of a server that was reached: it is full, starting or draining, its device was lost, it stopped
// during the call, or a proxy has no server behind it now.
std::optional<absl::Duration> retry_after(const absl::Status& status);

struct RetryOptions {
  // The time to try again after the first refusal. 0: each server is asked once.
  absl::Duration limit = absl::Seconds(30);
  // No wait lasts beyond it.
  absl::Time deadline = absl::InfiniteFuture();
  // Called before each wait, with the number of the server that failed last, its error and the time to wait.
  std::function<void(size_t server, const absl::Status& why, absl::Duration wait)> on_wait = nullptr;
  // If it is notified, the wait ends and the result is CANCELLED. Not owned.
  const absl::Notification* stop = nullptr;
};

// Calls `attempt` with the number of a server, from 0, until it returns OK or an error that does not pass by
// itself. It asks one server after the other, no server earlier than the server's RetryInfo said, and waits
// at random a little longer, so that a crowd does not come back together. If no server is reached in the
// first round, it returns the last error at once. UNAVAILABLE with the last refusal if none does the work
// within the limit.
absl::Status retry(size_t servers, const RetryOptions& options,
                   absl::FunctionRef<absl::Status(size_t server)> attempt);

}  // namespace candela
