// When to try a call again.
#pragma once

#include <grpcpp/support/status.h>

#include <cstddef>
#include <cstdint>
#include <optional>
#include <random>
#include <vector>

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "absl/time/time.h"
#include "client/retry.h"
#include "server/base/clock.h"

namespace candela {

// retry() with the caller's clock, which tests move.

// `wait` waits for that long; if it returns false, the result is CANCELLED. options.stop is not looked at.
absl::Status retry_by(Clock& clock, absl::FunctionRef<bool(absl::Duration)> wait, size_t servers,
                      const RetryOptions& options, absl::FunctionRef<absl::Status(size_t server)> attempt);

// The wait that a busy server asks of a client before its next call.

// The delay in the status's google.rpc.RetryInfo, or zero if it has none that can be read.
absl::Duration retry_delay(const grpc::Status& status);

// Notes in a user's status that a server was reached and may do the work after `delay`; see retry_after().
void set_retry_delay(absl::Status& status, absl::Duration delay);
std::optional<absl::Duration> noted_retry_delay(const absl::Status& status);

// Which of several servers to call next, and when.
//
// The servers are called in turn. The first round over all of them has no pauses; with a single server, its
// first try again has none. Then the pauses between rounds double, up to 1 s. Pauses and the times
// that servers name get up to half as much again at random, so that clients that one server refused together
// do not come back together. The same seed gives the same pauses. Used by one thread.
class RetrySchedule {
 public:
  RetrySchedule(size_t servers, uint32_t seed) : not_before_(servers, absl::InfinitePast()), random_(seed) {}

  // The server to call next, counted from 0.
  size_t next() const { return next_; }

  // That call failed `now`. The server asks for a wait of `delay`. `progress`: the call did some of its work
  // first, so the pauses start at the shortest again.
  void failed(absl::Time now, absl::Duration delay, bool progress = false);

  // True if every server has failed since the last progress.
  bool round_over() const { return attempts_ >= not_before_.size(); }

  // When to make the next call.
  absl::Time when() const { return when_; }

 private:
  size_t next_ = 0;
  size_t attempts_ = 0;                 // calls since the last progress
  std::vector<absl::Time> not_before_;  // when each server wants to be called again
  absl::Time when_ = absl::InfinitePast();
  std::minstd_rand random_;
};

}  // namespace candela
