#include "server/rpc/server_call.h"

#include <utility>

#include "absl/strings/str_format.h"
#include "server/rpc/status.h"

namespace candela {
namespace {

constexpr int kMaxUploadTimeouts = 10;  // the longest upload of one frame, in idle timeouts

}  // namespace

ServerCall::ServerCall(CallTransport& transport, ServiceState& state, CallGate& gate)
    : transport_(transport),
      clock_(state.clock),
      timers_(state.timers),
      gate_(gate),
      idle_timeout_(state.limits.idle_timeout) {}

void ServerCall::start() {
  absl::MutexLock lock(&mutex_);
  if (absl::Status status = gate_.enter(); !status.ok()) return finish(status);
  inside_ = true;
  on_entered();
}

void ServerCall::on_cancel() {
  absl::MutexLock lock(&mutex_);
  if (!finished_) finish(absl::CancelledError("call was cancelled"));
}

void ServerCall::finish(const absl::Status& status) {
  finished_ = true;
  const grpc::Status told = to_grpc(status);
  on_finish(status, told.error_message());
  if (inside_) {
    gate_.give_up_place();
    watch_idle(idle_timeout_);
  }
  transport_.finish(told);
}

void ServerCall::on_done() {
  bool inside = false;
  {
    absl::MutexLock lock(&mutex_);
    idle_timer_.reset();
    watch_ = 0;
    inside = inside_;
  }
  if (inside) gate_.leave();
}

void ServerCall::if_running(absl::FunctionRef<void()> then) {
  absl::MutexLock lock(&mutex_);
  if (!finished_) then();
}

std::unique_ptr<Timer> ServerCall::if_running_after(absl::Duration wait, std::function<void()> then) {
  return call_after(wait, [this, then = std::move(then)] { if_running(then); });
}

std::unique_ptr<Timer> ServerCall::call_after(absl::Duration wait, std::function<void()> then) {
  return timers_.call_after(wait, [call = weak_from_this(), then = std::move(then)] {
    if (const std::shared_ptr<ServerCall> alive = call.lock()) then();
  });
}

void ServerCall::watch_idle(absl::Duration wait) {
  ++watch_;
  idle_timer_ = call_after(wait, [this, watch = watch_] { on_timer(watch); });
}

absl::Status ServerCall::check_upload_time(absl::string_view frame, absl::Duration taken) const {
  if (taken <= kMaxUploadTimeouts * idle_timeout_) return absl::OkStatus();
  return absl::DeadlineExceededError(absl::StrFormat(
      "%s was not complete after %s, %d times this server's idle timeout; send it faster", frame,
      absl::FormatDuration(absl::Trunc(taken, absl::Milliseconds(1))), kMaxUploadTimeouts));
}

void ServerCall::on_timer(uint64_t watch) {
  absl::MutexLock lock(&mutex_);
  // It had fired when it was replaced or the call was done.
  if (watch != watch_) return;
  if (!finished_) return on_idle();
  // The peer reads nothing, so gRPC cannot even deliver the status: leave now.
  if (std::exchange(inside_, false)) {
    transport_.cancel();
    gate_.leave();
  }
}

}  // namespace candela
