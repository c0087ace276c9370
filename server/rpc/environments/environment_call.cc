#include "server/rpc/environments/environment_call.h"

#include <algorithm>
#include <utility>

#include "absl/hash/hash.h"
#include "absl/strings/str_format.h"
#include "server/base/status_macros.h"
#include "server/schedule/frame_metrics.h"

namespace candela {

EnvironmentCall::EnvironmentCall(CallTransport& transport, ServiceState& state)
    : ServerCall(transport, state, state.call_gate),
      state_(state),
      client_(absl::HashOf(transport.identity(state.limits.tokens))),
      last_progress_(clock_.now()) {}

void EnvironmentCall::on_entered() {
  visit_.emplace(state_.sessions.memory->presence(), client_);
  watch_idle(std::min(idle_timeout(), ClientMemory::kLookInterval));
  transport_.start_read(&incoming_);
}

void EnvironmentCall::on_read_done(bool ok) {
  absl::MutexLock lock(&mutex_);
  if (finished()) return;
  last_progress_ = clock_.now();
  if (ok) state_.metrics.bytes_in(incoming_.Length());
  if (absl::Status status = on_read(ok); !status.ok()) finish(status);
}

absl::Status EnvironmentCall::work(std::function<absl::Status()> task, std::function<void()> then) {
  FrameJob job;
  job.flow = client_ << 1;
  job.task = std::move(task);
  job.done = [call = std::static_pointer_cast<EnvironmentCall>(shared_from_this()),
              then = std::move(then)](const absl::StatusOr<RenderedFrame>& ran) {
    absl::MutexLock lock(&call->mutex_);
    if (call->finished()) return;
    call->ticket_.reset();
    call->last_progress_ = call->clock_.now();
    if (!ran.ok()) return call->finish(ran.status());
    then();
  };
  job.deadline = transport_.deadline();
  ASSIGN_OR_RETURN(ticket_, state_.rendering.loop.submit(std::move(job)));
  return absl::OkStatus();
}

void EnvironmentCall::send(grpc::ByteBuffer message) {
  sending_ = true;
  last_progress_ = clock_.now();
  outgoing_ = std::move(message);
  state_.metrics.bytes_out(outgoing_.Length());
  transport_.start_write(&outgoing_);
}

void EnvironmentCall::on_write_done(bool ok) {
  absl::MutexLock lock(&mutex_);
  if (finished()) return;
  if (!ok) return finish(absl::CancelledError("client went away before it had its answer"));
  last_progress_ = clock_.now();
  on_sent();
}

void EnvironmentCall::on_finish(const absl::Status& status, const std::string&) {
  if (ticket_) state_.rendering.loop.cancel(*ticket_);
  if (!inside()) {
    state_.metrics.rejected(state_.call_gate.closed() ? Rejection::kDraining : Rejection::kCalls);
  } else if (const std::optional<Rejection> reason = rejection_of(status); reason && !status.ok()) {
    state_.metrics.rejected(*reason);
  }
  visit_.reset();
}

void EnvironmentCall::on_idle() {
  const absl::Time now = clock_.now();
  const absl::Duration idle = now - last_progress_;
  if (absl::Status status = check_upload(now, idle); !status.ok()) return finish(status);
  if (ticket_ || idle < idle_timeout()) {
    return watch_idle(std::min(idle_timeout(), ClientMemory::kLookInterval));
  }
  // A write that nobody reads never ends, and no status could follow it.
  if (sending_) return transport_.cancel();
  finish(absl::DeadlineExceededError(
      absl::StrFormat("nothing arrived for %s, this server's idle timeout; send without pauses",
                      absl::FormatDuration(idle_timeout()))));
}

}  // namespace candela
