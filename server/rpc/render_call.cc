#include "server/rpc/render_call.h"

#include <utility>

#include "absl/hash/hash.h"
#include "absl/strings/str_format.h"
#include "proto/candela/v1/message_wire.h"
#include "server/base/log.h"
#include "server/rpc/call_later.h"
#include "server/rpc/frame_metrics.h"
#include "server/rpc/status.h"

namespace candela {

RenderCall* RenderCall::begin(grpc::CallbackServerContext* context, Backend& backend, Work work) {
  std::shared_ptr<RenderCall> call(new RenderCall(context, backend, work));
  call->self_ = call;
  absl::MutexLock lock(&call->mutex_);
  call->enter();
  return call.get();
}

RenderCall::RenderCall(grpc::CallbackServerContext* context, Backend& backend, Work work)
    : context_(*context),
      backend_(backend),
      work_(work),
      flow_(absl::HashOf(context->peer()) << 1),
      begun_(absl::Now()),
      last_progress_(begun_) {}

void RenderCall::enter() {
  if (absl::Status status = backend_.gate.enter(); !status.ok()) return finish(status);
  inside_ = true;
  watch_idle(backend_.idle_timeout);
  StartRead(&incoming_);
}

void RenderCall::OnReadDone(bool ok) {
  absl::MutexLock lock(&mutex_);
  if (state_ == State::kFinished) return;
  last_progress_ = absl::Now();
  if (ok) backend_.metrics.bytes_in(incoming_.Length());
  absl::Status status;
  if (state_ == State::kStart) {
    status = ok ? take_start() : absl::InvalidArgumentError("call was half-closed before its start message");
  } else {
    status = ok ? take_band() : enqueue();
  }
  if (!status.ok()) return finish(status);
  if (ok && state_ != State::kChoosing) StartRead(&incoming_);
}

absl::Status RenderCall::take_start() {
  absl::StatusOr<RenderStart> start = read_render_start(incoming_, backend_.limits);
  incoming_.Clear();
  if (!start.ok()) return start.status();
  start_ = *std::move(start);
  if (work_ == Work::kMeter) {
    start_->verify = Verify::kNo;
    start_->settings.promise = {};
    start_->settings.bloom.intensity = 0.0f;
    start_->settings.exposure.metering.histogram = true;
  }
  if (!start_->settings.promise.given()) return admit();
  state_ = State::kChoosing;
  return backend_.loop.post([self = self_] { self->choose_tier(); });
}

void RenderCall::choose_tier() {
  FrameDesc desc;
  Settings settings;
  {
    absl::MutexLock lock(&mutex_);
    if (state_ == State::kFinished) return;
    desc = start_->desc;
    settings = start_->settings;
  }
  const absl::StatusOr<TierChoice> choice = backend_.tier_meter.choose(desc, settings);
  absl::MutexLock lock(&mutex_);
  if (state_ == State::kFinished) return;
  if (!choice.ok()) return finish(choice.status());
  start_->settings.tier = choice->tier;
  tier_reason_ = choice->reason;
  last_progress_ = absl::Now();
  if (absl::Status status = admit(); !status.ok()) return finish(status);
  StartRead(&incoming_);
}

absl::Status RenderCall::admit() {
  const RenderStart& start = *start_;
  const std::shared_ptr<Renderer> renderer = backend_.renderer();
  absl::StatusOr<FrameMemory> memory = renderer->allocate(start.desc, start.settings, start.verify);
  if (!memory.ok()) return memory.status();
  frame_ = std::make_shared<Frame>(
      Frame{renderer, *std::move(memory), start.settings, {start.sequence, start.previous}, work_});
  bands_.emplace(v1::kFrameBand, start.desc, start.row_stride_bytes);
  state_ = State::kBands;
  return absl::OkStatus();
}

absl::Status RenderCall::take_band() {
  FrameMemory& memory = frame_->memory;
  absl::Status status = bands_->read(incoming_, [&memory](uint32_t y) { return memory.input_row(y); });
  incoming_.Clear();
  return status;
}

absl::Status RenderCall::enqueue() {
  // A client that vanished looks like one that half-closed.
  if (context_.IsCancelled()) return absl::CancelledError("call was cancelled");
  if (absl::Status status = bands_->check_complete(); !status.ok()) return status;
  FrameJob job;
  job.frame = frame_;
  job.flow = flow_;
  job.deadline = absl::FromChrono(context_.deadline());
  job.done = [self = self_](absl::StatusOr<RenderedFrame> rendered) {
    self->on_rendered(std::move(rendered));
  };
  absl::StatusOr<Ticket> ticket = backend_.loop.submit(std::move(job));
  if (!ticket.ok()) return ticket.status();
  ticket_ = *ticket;
  state_ = State::kQueued;
  return absl::OkStatus();
}

void RenderCall::on_rendered(absl::StatusOr<RenderedFrame> rendered) {
  if (rendered.ok()) {
    ++backend_.frames_rendered;
    count_stages(backend_.metrics, *rendered);
  }
  absl::MutexLock lock(&mutex_);
  if (state_ == State::kFinished) return;
  if (!rendered.ok()) return finish(rendered.status());
  backend_.metrics.frame_ended(absl::StatusCode::kOk);
  state_ = State::kSending;
  last_progress_ = absl::Now();
  if (work_ == Work::kMeter) {
    frame_->memory = {};
    result_.emplace(std::make_shared<const std::string>(), v1::pack(meter_response(*frame_, *rendered)));
    return send_next();
  }
  v1::RenderResponse response;
  *response.mutable_header() = result_header(*frame_, *rendered, backend_.device);
  response.mutable_header()->set_tier_reason(tier_reason_);
  result_.emplace(frame_, v1::pack(response));
  send_next();
}

void RenderCall::OnWriteDone(bool ok) {
  absl::MutexLock lock(&mutex_);
  if (state_ == State::kFinished) return;
  if (!ok) return finish(absl::CancelledError("client went away before it had its result"));
  last_progress_ = absl::Now();
  send_next();
}

void RenderCall::send_next() {
  if (!result_->next(outgoing_)) return finish(absl::OkStatus());
  backend_.metrics.bytes_out(outgoing_.Length());
  StartWrite(&outgoing_);
}

void RenderCall::OnCancel() {
  absl::MutexLock lock(&mutex_);
  if (state_ == State::kFinished) return;
  // A frame that is being rendered already finishes, is discarded, and only then gives its memory back.
  if (state_ == State::kQueued) backend_.loop.cancel(ticket_);
  finish(absl::CancelledError("call was cancelled"));
}

void RenderCall::count_end(const absl::Status& status) {
  Metrics& metrics = backend_.metrics;
  if (state_ == State::kBands || state_ == State::kQueued) return metrics.frame_ended(status.code());
  if (state_ == State::kSending) return;  // counted when it was rendered
  if (!inside_) return metrics.rejected(backend_.gate.closed() ? Rejection::kDraining : Rejection::kCalls);
  if (const std::optional<Rejection> reason = rejection_of(status)) metrics.rejected(*reason);
}

void RenderCall::finish(const absl::Status& status) {
  count_end(status);
  state_ = State::kFinished;
  const grpc::Status told = to_grpc(status);
  log_event(LogLevel::kInfo, "render call ended",
            {{"peer", context_.peer()},
             {"sequence", start_ ? start_->sequence : 0},
             {"status", absl::StatusCodeToString(status.code())},
             {"message", told.error_message()}});
  result_.reset();
  frame_.reset();
  if (inside_) watch_idle(backend_.idle_timeout);
  Finish(told);
}

void RenderCall::OnDone() {
  std::shared_ptr<RenderCall> self;  // outlives the lock
  bool inside = false;
  {
    absl::MutexLock lock(&mutex_);
    idle_alarm_.reset();
    inside = inside_;
    self = std::move(self_);
  }
  if (inside) backend_.gate.leave();
}

void RenderCall::watch_idle(absl::Duration wait) {
  idle_alarm_ = call_later(wait, weak_from_this(), &RenderCall::on_idle);
}

void RenderCall::on_idle() {
  absl::MutexLock lock(&mutex_);
  if (state_ == State::kFinished) {
    // gRPC cannot even deliver the status, for the peer reads nothing. Its place is not kept for it. After
    // OnDone, which lets go of self_, there is no place to give up.
    if (self_ != nullptr && std::exchange(inside_, false)) {
      context_.TryCancel();
      backend_.gate.leave();
    }
    return;
  }
  if (state_ == State::kQueued || state_ == State::kChoosing)
    return watch_idle(backend_.idle_timeout);  // it waits for us
  if (state_ == State::kBands && absl::Now() - begun_ > kMaxUploadTimeouts * backend_.idle_timeout) {
    return finish(absl::DeadlineExceededError(absl::StrFormat(
        "the frame was not complete after %s, %d times this server's idle timeout; send it faster",
        absl::FormatDuration(absl::Trunc(absl::Now() - begun_, absl::Milliseconds(1))), kMaxUploadTimeouts)));
  }
  const absl::Duration idle = absl::Now() - last_progress_;
  if (idle < backend_.idle_timeout) return watch_idle(backend_.idle_timeout - idle);
  // A write that nobody reads never ends by itself, and no status could follow it.
  if (state_ == State::kSending) return context_.TryCancel();
  finish(absl::DeadlineExceededError(
      absl::StrFormat("nothing arrived for %s, this server's idle timeout; send the frame without pauses",
                      absl::FormatDuration(backend_.idle_timeout))));
}

}  // namespace candela
