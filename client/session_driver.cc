#include "client/session_driver.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_format.h"
#include "server/base/check.h"

namespace candela {

SessionDriver::SessionDriver(SessionServers& servers, const SessionOptions& options, const std::string& name,
                             SessionState& state, SessionMemory& memory, Clock& clock, uint32_t seed)
    : servers_(servers),
      options_(options),
      name_(name),
      state_(state),
      memory_(memory),
      clock_(clock),
      schedule_(servers.count(), seed) {}

void SessionDriver::start() { next_call(); }

void SessionDriver::on_event(CallEvent event) {
  switch (phase_) {
    case Phase::kIdle:
      return next_call();
    case Phase::kCalling:
      stream_->on_event(event);
      if (event == CallEvent::kEnded) end_call();
      return;
    case Phase::kPausing:
      if (event == CallEvent::kTimeout) return end_pause();
      if (state_.cancelled()) end(absl::CancelledError());
      return;
    case Phase::kPutting:  // also when it is cancelled: the answer comes soon
    case Phase::kEnded:
      return;
  }
}

absl::Time SessionDriver::deadline() const {
  switch (phase_) {
    case Phase::kCalling:
      return stream_->deadline();
    case Phase::kPausing:
      return pause_until_;
    default:
      return absl::InfiniteFuture();
  }
}

void SessionDriver::next_call() {
  const bool idle = std::exchange(phase_, Phase::kIdle) == Phase::kIdle;
  const SessionState::Need need = state_.need(idle);
  if (need == SessionState::Need::kNotYet) return;
  if (need == SessionState::Need::kOver) return end(absl::OkStatus());
  // There is something to send again, but the pause after the loss is not over.
  const bool too_early = idle && state_.was_open() && clock_.now() < schedule_.when();
  if (too_early && !state_.cancelled()) return pause_after_loss();
  server_ = schedule_.next();
  const std::string& address = servers_.address(server_);
  std::optional<SessionState::Start> start = state_.begin_call(address);
  if (!start) return end(absl::CancelledError());
  memory_.begin_call(address);
  stream_ = std::make_unique<SessionStream>(servers_.call(server_, name_), address, asked_, *std::move(start),
                                            options_, name_, state_, memory_, clock_);
  phase_ = Phase::kCalling;
}

void SessionDriver::end_call() {
  last_ = stream_->end();
  stream_.reset();
  asked_ |= last_.asked;
  // The call brought results, so a server that now lacks a panorama has dropped it since, and may get it
  // again.
  if (last_.progress) put_.clear();
  if (absl::IsNotFound(last_.status)) {
    unput_ = state_.panoramas();
    for (const std::string& id : put_) unput_.erase(id);
    if (put_next()) return;
    // It had them all, and has lost one again. It is left as if it were lost itself.
    last_.resume = !put_.empty();
  }
  call_failed();
}

// The server lacks the environment of a view. It gets the panoramas of all views that have no result yet, one
// after the other, and none twice in a row.
bool SessionDriver::put_next() {
  if (unput_.empty() || state_.cancelled()) return false;
  phase_ = Phase::kPutting;
  servers_.put(server_, unput_.begin()->second, clock_.now() + options_.silence_limit);
  return true;
}

void SessionDriver::on_put(const absl::StatusOr<v1::Environment>& put) {
  CHECK(phase_ == Phase::kPutting);
  const std::string id = unput_.begin()->first;
  if (put.ok() && put->id() == id) {
    put_.insert(id);
    unput_.erase(unput_.begin());
    if (unput_.empty()) return next_call();
    return put_next() ? void() : call_failed();
  }
  last_.status = put.ok() ? absl::InvalidArgumentError(absl::StrFormat(
                                "the view's environment is %s, and that of its panorama %s", id, put->id()))
                          : put.status();
  last_.resume = absl::IsUnavailable(last_.status);
  call_failed();
}

// The session goes on after the last call, or ends with it.
void SessionDriver::call_failed() {
  put_.clear();
  if (last_.status.ok() || !last_.resume || state_.cancelled()) return end(last_.status);
  schedule_.failed(clock_.now(), last_.retry_delay, last_.progress);
  return state_.was_open() ? pause_after_loss() : pause_before_open();
}

// An open session has lost its server. The limit counts from when it needs one.
void SessionDriver::pause_after_loss() {
  pause_limit_ = state_.lose(last_.status) + options_.resume_limit;
  const SessionState::Need need = state_.need(/*idle=*/false);
  if (need == SessionState::Need::kOver) return end(absl::OkStatus());
  phase_ = need == SessionState::Need::kCall ? Phase::kPausing : Phase::kIdle;
  pause_until_ = std::min(schedule_.when(), pause_limit_);
}

// The last server has not opened the session. Fails if none of them can be reached, or if those that can
// still refuse it after the limit.
void SessionDriver::pause_before_open() {
  // A server that refuses may take the session later. One that cannot be reached is not waited for.
  if (last_.reached) {
    if (refusal_.ok()) open_by_ = clock_.now() + options_.resume_limit;
    refusal_ = last_.status;
  }
  if (!schedule_.round_over()) return next_call();
  if (refusal_.ok()) return end(last_.status);
  if (options_.resume_limit <= absl::ZeroDuration()) return end(refusal_);
  if (schedule_.when() >= open_by_) {
    return end(absl::UnavailableError(absl::StrFormat("no server opens the session within %s: %s",
                                                      absl::FormatDuration(options_.resume_limit),
                                                      refusal_.message())));
  }
  if (options_.on_open_wait) options_.on_open_wait(servers_.address(server_), refusal_);
  phase_ = Phase::kPausing;
  pause_until_ = schedule_.when();
}

void SessionDriver::end_pause() {
  if (clock_.now() < pause_limit_) return next_call();
  end(absl::UnavailableError(absl::StrFormat("no server has taken the session on for %s: %s",
                                             absl::FormatDuration(options_.resume_limit),
                                             last_.status.message())));
}

void SessionDriver::end(const absl::Status& status) {
  phase_ = Phase::kEnded;
  state_.end(status);
}

}  // namespace candela
