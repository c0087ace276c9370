#include "server/rpc/render_call.h"

#include <algorithm>
#include <utility>

#include "absl/hash/hash.h"
#include "absl/strings/str_format.h"
#include "proto/candela/v1/message_wire.h"
#include "server/base/log.h"
#include "server/base/status_macros.h"
#include "server/rpc/band_reader.h"
#include "server/schedule/render_loop.h"

namespace candela {

std::shared_ptr<ServerCall> RenderCall::begin(CallTransport& transport, ServiceState& state, Work work) {
  std::shared_ptr<RenderCall> call(new RenderCall(transport, state, work));
  call->start();
  return call;
}

RenderCall::RenderCall(CallTransport& transport, ServiceState& state, Work work)
    : ServerCall(transport, state, state.call_gate),
      service_(state),
      work_(work),
      client_(absl::HashOf(transport.identity(state.limits.tokens))),
      flow_(client_ << 1),
      admission_(*this, state, client_),
      begun_(clock_.now()),
      last_progress_(begun_) {}

void RenderCall::on_entered() {
  visit_.emplace(service_.sessions.memory->presence(), client_);
  watch_idle(std::min(idle_timeout(), ClientMemory::kLookInterval));
  transport_.start_read(&incoming_);
}

void RenderCall::on_read_done(bool ok) {
  absl::MutexLock lock(&mutex_);
  if (finished()) return;
  last_progress_ = clock_.now();
  if (ok) service_.metrics.bytes_in(incoming_.Length());
  absl::Status status;
  if (state_ == State::kStart) {
    status = ok ? take_start() : absl::InvalidArgumentError("call was half-closed before its start message");
  } else if (ok && state_ == State::kFirstBand) {
    admit();
  } else {
    status = ok ? take_band() : enqueue();
  }
  if (!status.ok()) finish(status);
}

absl::Status RenderCall::take_start() {
  v1::RenderRequest request;
  RETURN_IF_ERROR(parse_request(incoming_, request));
  incoming_.Clear();
  ASSIGN_OR_RETURN(start_, render_start_from(request, service_.limits.frame));
  if (work_ == Work::kMeter) {
    start_->verify = Verify::kNo;
    start_->settings = start_->settings.for_metering(/*histogram=*/true);
  }
  Admission::Request asked{.desc = start_->layout.desc,
                           .sequence = start_->sequence,
                           .settings = start_->settings,
                           .verify = start_->verify,
                           .flow = flow_};
  const v1::FrameHeader& header = request.start().frame();
  const v1::Settings& settings = *start_->settings;
  ASSIGN_OR_RETURN(shared_,
                   client_pixels_from(header, start_->layout, image_size(settings, start_->layout.desc),
                                      settings.output_format(), transport_.straight_from_this_host(),
                                      /*raw=*/work_ == Work::kRender, service_.regions));
  if (header.has_view()) {
    RETURN_IF_ERROR(use_view(header.view(), /*held=*/nullptr, service_, asked));
  }
  RETURN_IF_ERROR(admission_.expect(std::move(asked)));
  if (has_no_bands(header)) {
    admit();
    return absl::OkStatus();
  }
  bands_.emplace(v1::kFrameBand, start_->layout, clock_,
                 [this](absl::Duration took) { service_.rendering.loop.charge(flow_, took); });
  state_ = State::kFirstBand;
  transport_.start_read(&incoming_);
  return absl::OkStatus();
}

void RenderCall::admit() {
  state_ = State::kAdmission;
  admission_.begin([this](absl::StatusOr<std::shared_ptr<Frame>> admitted)
                       ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) { on_admitted(std::move(admitted)); });
}

void RenderCall::on_admitted(absl::StatusOr<std::shared_ptr<Frame>> admitted) {
  if (!admitted.ok()) return finish(admitted.status());
  frame_ = *std::move(admitted);
  state_ = State::kBands;
  last_progress_ = clock_.now();
  admitted_ = last_progress_;
  if (shared_) {
    frame_->image_in_memory = shared_->image != nullptr;
    frame_->memory.share(*std::exchange(shared_, std::nullopt));
  }
  if (!bands_) return transport_.start_read(&incoming_);  // the half-close
  if (absl::Status status = take_band(); !status.ok()) finish(status);
}

absl::Status RenderCall::take_band() {
  if (!bands_)
    return absl::InvalidArgumentError("a band came, but the frame has a view or memory; half-close instead");
  FrameMemory& memory = frame_->memory;
  absl::Status status = bands_->read(incoming_, [&memory](uint32_t y) { return memory.input_row(y); });
  incoming_.Clear();
  if (status.ok()) transport_.start_read(&incoming_);
  return status;
}

absl::Status RenderCall::enqueue() {
  // gRPC reports a client that vanished as one that half-closed.
  if (transport_.is_cancelled()) return absl::CancelledError("call was cancelled");
  if (bands_) {
    RETURN_IF_ERROR(bands_->check_complete());
  }
  FrameJob job{.frame = frame_, .work = work_, .ordered = false, .flow = flow_};
  job.deadline = transport_.deadline();
  job.decide = [exposure = frame_->settings->exposure(), previous = start_->previous,
                given = start_->given](const FrameStats& stats) {
    return expose(exposure, previous, stats.metered_mean(), given);
  };
  job.done = [self = self()](absl::StatusOr<RenderedFrame> rendered) {
    self->on_rendered(std::move(rendered));
  };
  ASSIGN_OR_RETURN(ticket_, service_.rendering.loop.submit(std::move(job)));
  state_ = State::kQueued;
  return absl::OkStatus();
}

void RenderCall::on_rendered(absl::StatusOr<RenderedFrame> rendered) {
  if (rendered.ok()) {
    ++service_.rendering.frames_rendered;
    count_stages(service_.metrics, *rendered);
  }
  absl::MutexLock lock(&mutex_);
  if (finished()) return;
  if (!rendered.ok()) return finish(rendered.status());
  service_.metrics.frame_ended(absl::StatusCode::kOk);
  state_ = State::kSending;
  last_progress_ = clock_.now();
  if (work_ == Work::kMeter) {
    result_.emplace(std::make_shared<const std::string>(),
                    v1::pack(meter_response(*rendered, frame_->settings, start_->previous, start_->given)));
    frame_->memory = {};
    return send_next();
  }
  v1::RenderResponse response;
  *response.mutable_header() = result_header(*frame_, start_->layout, *rendered, service_.rendering.device);
  const bool rgb = leaves_out_alpha(*frame_, start_->layout, rendered->report);
  response.mutable_header()->set_alpha_left_out(rgb);
  result_.emplace(frame_, v1::pack(response), rgb);
  send_next();
}

void RenderCall::on_write_done(bool ok) {
  absl::MutexLock lock(&mutex_);
  if (finished()) return;
  if (!ok) return finish(absl::CancelledError("client went away before it had its result"));
  last_progress_ = clock_.now();
  send_next();
}

void RenderCall::send_next() {
  if (!result_->next(outgoing_)) return finish(absl::OkStatus());
  service_.metrics.bytes_out(outgoing_.Length());
  transport_.start_write(&outgoing_);
}

void RenderCall::count_end(const absl::Status& status) {
  Metrics& metrics = service_.metrics;
  if (state_ == State::kBands || state_ == State::kQueued) {
    return metrics.frame_ended(client_too_slow_ ? absl::StatusCode::kCancelled : status.code());
  }
  if (state_ == State::kSending) return;  // it was counted when it was rendered
  if (!inside()) {
    return metrics.rejected(service_.call_gate.closed() ? Rejection::kDraining : Rejection::kCalls);
  }
  if (const std::optional<Rejection> reason = rejection_of(status)) metrics.rejected(*reason);
}

void RenderCall::on_finish(const absl::Status& status, const std::string& message) {
  // A frame that is being rendered is finished and discarded, and releases its memory only then.
  if (state_ == State::kQueued) service_.rendering.loop.cancel(ticket_);
  count_end(status);
  log_event(LogLevel::kInfo, "render call ended",
            {{"peer", transport_.peer()},
             {"sequence", start_ ? start_->sequence : 0},
             {"status", absl::StatusCodeToString(status.code())},
             {"message", message}});
  admission_.end();
  result_.reset();
  shared_.reset();
  frame_.reset();
  visit_.reset();
}

void RenderCall::on_idle() {
  // In these states the client waits for the server.
  if (state_ == State::kQueued || state_ == State::kAdmission) {
    return watch_idle(std::min(idle_timeout(), ClientMemory::kLookInterval));
  }
  const absl::Time now = clock_.now();
  const absl::Duration idle = now - last_progress_;
  if (state_ == State::kBands) {
    if (absl::Status slow = check_upload_time("the frame", now - admitted_); !slow.ok())
      return give_up_on_client(slow);
    const absl::Status yield =
        service_.sessions.memory->check_upload(client_, frame_->memory.bytes(), now - admitted_, idle, now);
    if (!yield.ok()) return finish(yield);
  }
  if (idle < idle_timeout()) return watch_idle(std::min(idle_timeout() - idle, ClientMemory::kLookInterval));
  // A write that nobody reads never ends, and no status could follow it.
  if (state_ == State::kSending) return transport_.cancel();
  give_up_on_client(absl::DeadlineExceededError(
      absl::StrFormat("nothing arrived for %s, this server's idle timeout; send the frame without pauses",
                      absl::FormatDuration(idle_timeout()))));
}

void RenderCall::give_up_on_client(const absl::Status& status) {
  client_too_slow_ = true;
  finish(status);
}

}  // namespace candela
