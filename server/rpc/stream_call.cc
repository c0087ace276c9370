#include "server/rpc/stream_call.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_format.h"
#include "absl/time/clock.h"
#include "proto/candela/v1/message_wire.h"
#include "server/base/log.h"
#include "server/rpc/call_later.h"
#include "server/rpc/frame_metrics.h"
#include "server/rpc/status.h"

namespace candela {

namespace {

// How often a frame that found no memory asks again.
constexpr absl::Duration kMemoryRetry = absl::Milliseconds(5);

// Of a frame, and not of the session.
bool is_frames_own(const absl::Status& status) {
  return absl::IsInvalidArgument(status) || absl::IsDeadlineExceeded(status);
}

std::string words(absl::Duration duration) {
  return absl::FormatDuration(absl::Trunc(duration, absl::Milliseconds(1)));
}

}  // namespace

StreamCall* StreamCall::begin(grpc::CallbackServerContext* context, Backend& backend) {
  std::shared_ptr<StreamCall> call(new StreamCall(context, backend));
  call->self_ = call;
  absl::MutexLock lock(&call->mutex_);
  call->enter();
  return call.get();
}

StreamCall::StreamCall(grpc::CallbackServerContext* context, Backend& backend)
    : context_(*context),
      backend_(backend),
      flow_(backend.next_session_flow.fetch_add(2)),
      last_read_(absl::Now()),
      last_write_(last_read_) {}

void StreamCall::enter() {
  if (absl::Status status = backend_.session_gate.enter(); !status.ok()) return finish(status);
  inside_ = true;
  watch_idle(backend_.idle_timeout / 2);
  read_on();
}

size_t StreamCall::capacity() const {
  return backend_.max_frames_in_flight + (start_ ? start_->lookahead : 0);
}

// Reading.

void StreamCall::read_on() {
  if (finished_ || ending_ || reading_) return;
  const bool wanted = state_ == Reading::kOpen || state_ == Reading::kBands ||
                      (state_ == Reading::kBetween && frames_.size() < capacity());
  if (!wanted) return;
  reading_ = true;
  last_read_ = absl::Now();
  StartRead(&incoming_);
}

void StreamCall::OnReadDone(bool ok) {
  absl::MutexLock lock(&mutex_);
  reading_ = false;
  if (finished_ || ending_) return;
  last_read_ = absl::Now();
  if (ok) backend_.metrics.bytes_in(incoming_.Length());
  grpc::ByteBuffer message;  // the next read may begin before this one is understood
  message.Swap(&incoming_);
  const absl::Status status = ok ? take_message(message) : half_closed();
  if (!status.ok()) return read_no_more(status);
  read_on();
}

absl::Status StreamCall::take_message(grpc::ByteBuffer& message) {
  if (state_ == Reading::kOpen) return take_open(message);
  return state_ == Reading::kBands ? take_band(message) : take_between(message);
}

absl::Status StreamCall::take_open(grpc::ByteBuffer& message) {
  v1::StreamRequest request;
  if (absl::Status status = parse_request(message, request); !status.ok()) return status;
  if (!request.has_open()) {
    return absl::InvalidArgumentError("first message holds no `open`; send it before the frames");
  }
  absl::StatusOr<StreamStart> start = stream_start_from(request.open());
  if (!start.ok()) return start.status();
  ResumePoint point;
  const bool resumed = !start->resume_token.empty();
  if (resumed) {
    absl::StatusOr<ResumePoint> opened = backend_.keys.open(start->resume_token, start->session, absl::Now());
    if (!opened.ok()) return opened.status();
    point = *std::move(opened);
    if (point.settings_hash != start->settings.hash) {
      return absl::FailedPreconditionError(
          "resume_token was given with a result that had other settings; open with those, and change them "
          "after");
    }
    epoch_ = point.epoch + 1;
  }
  absl::StatusOr<std::shared_ptr<SessionCall>> before =
      backend_.sessions.enter(start->session, epoch_, resumed, self_);
  if (!before.ok()) return before.status();
  if (*before) (*before)->give_up();
  // Too late for go_away, which is told to the sessions in the table when the gate has closed.
  if (backend_.session_gate.closed()) {
    backend_.sessions.leave(start->session, this);
    return absl::UnavailableError("server is draining and takes no new sessions; use another one");
  }
  told_ = point.exposure;
  settings_.emplace(std::move(start->settings), start->encoding);
  if (resumed) settings_->resume(point.sequence, point.tier);
  track_.emplace(start->lookahead, start->cut_threshold_ev, point.exposure);
  start_ = *std::move(start);
  backend_.metrics.session_began();
  log_event(LogLevel::kInfo, resumed ? "session resumed" : "session opened",
            {{"session", start_->session}, {"peer", context_.peer()}, {"epoch", epoch_}});
  v1::StreamResponse response;
  v1::StreamOpened& opened = *response.mutable_opened();
  opened.set_session(start_->session);
  opened.set_max_frames_in_flight(backend_.max_frames_in_flight);
  opened.set_epoch(epoch_);
  notices_.push_back(v1::pack(response));
  state_ = Reading::kBetween;
  write_on();
  return absl::OkStatus();
}

absl::Status StreamCall::take_between(grpc::ByteBuffer& message) {
  v1::StreamRequest request;
  if (absl::Status status = parse_request(message, request); !status.ok()) return status;
  if (request.has_frame()) return take_header(request.frame());
  if (request.has_change()) return settings_->add(request.change());
  return absl::InvalidArgumentError(
      request.has_band() ? "a band came and the frame before it has every row; send `frame` first"
                         : "message holds neither `frame` nor `change` where one is due");
}

absl::Status StreamCall::take_header(const v1::FrameHeader& header) {
  const absl::StatusOr<FrameLayout> layout = frame_layout_from(header, backend_.limits);
  if (!layout.ok()) return layout.status();
  settings_->advance(header.sequence());
  const Settings& settings = settings_->now().settings;
  if (absl::Status status = check_settings_for(settings, layout->desc); !status.ok()) return status;
  if (absl::Status status =
          track_->add(header.sequence(), header.media_time_ns(), header.cut(), settings.exposure);
      !status.ok()) {
    return status;
  }
  auto frame = std::make_shared<SessionFrame>();
  frame->sequence = header.sequence();
  frame->cut = header.cut();
  frame->layout = *layout;
  if (header.timeout_ms() > 0) frame->deadline = absl::Now() + absl::Milliseconds(header.timeout_ms());
  frame->settings_hash = settings_->now().hash;
  frames_.push_back(std::move(frame));
  memory_deadline_ = absl::Now() + backend_.idle_timeout;
  return settings_->wants_tier() ? ask_for_tier() : admit();
}

absl::Status StreamCall::ask_for_tier() {
  state_ = Reading::kChoosing;
  return backend_.loop.post([self = self_] { self->choose_tier(); });
}

void StreamCall::choose_tier() {
  FrameDesc desc;
  Settings settings;
  {
    absl::MutexLock lock(&mutex_);
    if (finished_ || ending_) return;
    desc = frames_.back()->layout.desc;
    settings = settings_->now().settings;
  }
  absl::StatusOr<TierChoice> choice = backend_.tier_meter.choose(desc, settings);
  absl::MutexLock lock(&mutex_);
  if (finished_ || ending_) return;
  if (absl::IsUnavailable(choice.status()) && absl::Now() < memory_deadline_) {
    memory_alarm_ = call_later(kMemoryRetry, weak_from_this(), &StreamCall::retry);
    return;
  }
  if (!choice.ok()) return read_no_more(choice.status());
  settings_->choose(*std::move(choice));
  memory_deadline_ = absl::Now() + backend_.idle_timeout;
  if (absl::Status status = admit(); !status.ok()) return read_no_more(status);
  read_on();
}

absl::Status StreamCall::admit() {
  const FramePtr& frame = frames_.back();
  Settings settings = settings_->of_frame();
  frame->tier = settings_->tier();
  frame->tier_reason = settings_->tier_reason();
  const std::shared_ptr<Renderer> renderer = backend_.renderer();
  absl::StatusOr<FrameMemory> memory = renderer->allocate(frame->layout.desc, settings);
  if (memory.ok()) {
    if (absl::Status status = promise_lookahead(*memory); !status.ok()) memory = std::move(status);
  }
  if (absl::IsUnavailable(memory.status()) && absl::Now() < memory_deadline_) {
    state_ = Reading::kMemory;
    memory_alarm_ = call_later(kMemoryRetry, weak_from_this(), &StreamCall::retry);
    return absl::OkStatus();
  }
  if (!memory.ok()) return memory.status();
  frame->frame = std::make_shared<Frame>(
      Frame{renderer, *std::move(memory), std::move(settings), {frame->sequence, std::nullopt}});
  frame->begun = absl::Now();
  bands_.emplace(v1::kStreamFrameBand, frame->layout.desc, frame->layout.row_stride_bytes);
  state_ = Reading::kBands;
  return absl::OkStatus();
}

// That all frames of the session's look-ahead can have as much at once.
absl::Status StreamCall::promise_lookahead(const FrameMemory& memory) {
  if (plain()) return absl::OkStatus();
  const FrameDesc& desc = memory.desc();
  const uint64_t wanted = memory.bytes() * (start_->lookahead + 1);
  if (wanted > backend_.memory_budget_bytes) {
    return absl::ResourceExhaustedError(
        absl::StrFormat("a look-ahead of %d frames of %dx%d takes %d bytes and this server's memory budget "
                        "is %d; ask for one of at most %d",
                        start_->lookahead, desc.width, desc.height, wanted, backend_.memory_budget_bytes,
                        backend_.memory_budget_bytes / memory.bytes() - 1));
  }
  if (wanted <= promised_bytes_) return absl::OkStatus();
  if (!backend_.lookahead_memory.change(promised_bytes_, wanted)) {
    return absl::UnavailableError(absl::StrFormat(
        "a look-ahead of %d frames of %dx%d takes %d bytes, and other sessions' look-ahead %d "
        "of this server's memory budget of %d; try again when they have ended, look less far "
        "ahead, or raise --memory-budget",
        start_->lookahead, desc.width, desc.height, wanted,
        backend_.lookahead_memory.promised() - promised_bytes_, backend_.memory_budget_bytes));
  }
  promised_bytes_ = wanted;
  return absl::OkStatus();
}

// For memory.
void StreamCall::retry() {
  absl::MutexLock lock(&mutex_);
  if (finished_ || ending_ || (state_ != Reading::kMemory && state_ != Reading::kChoosing)) return;
  const absl::Status status = state_ == Reading::kMemory ? admit() : ask_for_tier();
  if (!status.ok()) return read_no_more(status);
  read_on();
}

absl::Status StreamCall::take_band(grpc::ByteBuffer& message) {
  const FramePtr frame = frames_.back();
  FrameMemory& memory = frame->frame->memory;
  absl::Status status = bands_->read(message, [&memory](uint32_t y) { return memory.input_row(y); });
  if (!status.ok() || !bands_->complete()) return status;
  bands_.reset();
  state_ = Reading::kBetween;
  return submit(frame, plain() ? Work::kRender : Work::kMeter);
}

absl::Status StreamCall::half_closed() {
  // A client that vanished looks like one that half-closed.
  if (context_.IsCancelled()) return absl::CancelledError("call was cancelled");
  if (state_ == Reading::kOpen) {
    return absl::InvalidArgumentError("call was half-closed before its open message");
  }
  if (state_ == Reading::kBands) return bands_->check_complete();
  state_ = Reading::kClosed;
  track_->end();
  if (absl::Status status = submit_decided(); !status.ok()) return status;
  write_on();
  return absl::OkStatus();
}

// Rendering.

absl::Status StreamCall::submit(const FramePtr& frame, Work work) {
  frame->frame->work = work;
  if (work == Work::kRender) {
    frame->frame->expose = [self = self_, weak = std::weak_ptr(frame)](const FrameStats& stats) {
      const FramePtr metered = weak.lock();
      return metered ? self->expose(metered, stats) : Exposed();
    };
  } else if (work == Work::kDraw) {
    frame->frame->expose = [exposed = frame->exposure.exposed](const FrameStats&) { return exposed; };
  }
  FrameJob job;
  job.frame = frame->frame;
  job.flow = flow_;
  // Once it has taken part in the exposure of others it is rendered, too.
  if (work != Work::kDraw) job.deadline = frame->deadline;
  job.done = [self = self_, frame, work](absl::StatusOr<RenderedFrame> rendered) {
    self->on_worked(frame, work, std::move(rendered));
  };
  absl::StatusOr<Ticket> ticket = backend_.loop.submit(std::move(job));
  if (!ticket.ok()) return ticket.status();
  frame->ticket = *ticket;
  frame->stage = work == Work::kDraw ? Stage::kDrawing : Stage::kQueued;
  return absl::OkStatus();
}

// On the render thread, between a frame's two phases. Frames of a session are rendered in order, so that
// without look-ahead the one that was metered is the one that is decided.
Exposed StreamCall::expose(const FramePtr& frame, const FrameStats& stats) {
  absl::MutexLock lock(&mutex_);
  if (finished_ || frame->stage != Stage::kQueued) return {};
  track_->metered(frame->sequence, stats);
  frame->exposure = track_->next()->state;
  frame->decided = true;
  return frame->exposure.exposed;
}

void StreamCall::on_worked(const FramePtr& frame, Work work, absl::StatusOr<RenderedFrame> rendered) {
  if (rendered.ok()) count_stages(backend_.metrics, *rendered);
  if (rendered.ok() && work != Work::kMeter) ++backend_.frames_rendered;
  std::shared_ptr<Frame> dropped;  // outlives the lock: giving memory back takes its time
  absl::MutexLock lock(&mutex_);
  frame->frame->expose = nullptr;
  if (finished_ || frame->stage == Stage::kFailed) {
    dropped = std::move(frame->frame);
    return;
  }
  absl::Status status = rendered.status();
  if (status.ok()) {
    frame->queued += rendered->queued;
    if (work == Work::kMeter) {
      frame->meter_stages = std::move(rendered->report.stages);
      frame->stage = Stage::kWaiting;
      track_->metered(frame->sequence, rendered->report.stats);
      status = submit_decided();
    } else {
      frame->report = std::move(rendered->report);
      frame->report->stages.insert(frame->report->stages.begin(), frame->meter_stages.begin(),
                                   frame->meter_stages.end());
      finish_frame(frame);
    }
  } else if (is_frames_own(status) && !frame->decided) {
    dropped = std::move(frame->frame);
    backend_.metrics.frame_ended(status.code());
    frame->failure = std::exchange(status, absl::OkStatus());
    frame->stage = Stage::kFailed;
    track_->failed(frame->sequence);
    status = submit_decided();
  }
  if (!status.ok()) {
    const auto at = std::find(frames_.begin(), frames_.end(), frame);
    end_before(static_cast<size_t>(at - frames_.begin()), status);
  }
  write_on();
}

absl::Status StreamCall::submit_decided() {
  while (std::optional<FrameExposure> decided = track_->next()) {
    const auto frame = std::find_if(frames_.begin(), frames_.end(), [&](const FramePtr& candidate) {
      return candidate->stage == Stage::kWaiting && candidate->sequence == decided->sequence;
    });
    (*frame)->exposure = decided->state;
    (*frame)->decided = true;
    if (absl::Status status = submit(*frame, Work::kDraw); !status.ok()) return status;
  }
  return absl::OkStatus();
}

void StreamCall::finish_frame(const FramePtr& frame) {
  backend_.metrics.frame_ended(absl::StatusCode::kOk);
  if (start_->encoding == Encoding::kRaw) {
    frame->stage = Stage::kDone;
    return;
  }
  frame->stage = Stage::kEncoding;
  backend_.encoders.run([self = self_, frame, image = frame->frame, encoding = start_->encoding,
                         quality = start_->jpeg_quality] {
    const absl::Time begin = absl::Now();
    absl::StatusOr<std::string> file = encode_image(image->memory, image->settings, encoding, quality);
    self->on_encoded(frame, std::move(file), absl::Now() - begin);
  });
}

void StreamCall::on_encoded(const FramePtr& frame, absl::StatusOr<std::string> file, absl::Duration took) {
  absl::MutexLock lock(&mutex_);
  if (finished_ || frame->stage == Stage::kFailed) return;
  if (!file.ok()) {
    const auto at = std::find(frames_.begin(), frames_.end(), frame);
    end_before(static_cast<size_t>(at - frames_.begin()), file.status());
  } else {
    frame->file = std::make_shared<const std::string>(*std::move(file));
    backend_.metrics.stage("encode", took);
    frame->report->stages.push_back({"encode", static_cast<uint64_t>(absl::ToInt64Nanoseconds(took))});
    frame->stage = Stage::kDone;
  }
  write_on();
}

// Writing.

void StreamCall::OnWriteDone(bool ok) {
  absl::MutexLock lock(&mutex_);
  writing_ = false;
  if (finished_) return;
  if (!ok) return finish(absl::CancelledError("client went away before it had its results"));
  last_write_ = absl::Now();
  write_on();
}

void StreamCall::write_on() {
  if (finished_ || writing_) return;
  if (next_message()) {
    writing_ = true;
    last_write_ = absl::Now();
    backend_.metrics.bytes_out(outgoing_.Length());
    StartWrite(&outgoing_);
  } else if (frames_.empty() && (ending_ || state_ == Reading::kClosed)) {
    return finish(ending_.value_or(absl::OkStatus()));
  }
  read_on();
}

// Into outgoing_; false when there is none yet.
bool StreamCall::next_message() {
  if (!notices_.empty() && (frames_.empty() || !frames_.front()->writer)) {
    outgoing_.Swap(&notices_.front());
    notices_.pop_front();
    return true;
  }
  while (!frames_.empty()) {
    SessionFrame& frame = *frames_.front();
    if (frame.stage == Stage::kFailed) {
      outgoing_ = failure_message(frame);
      ++answered_;
      frames_.pop_front();
      return true;
    }
    if (frame.stage != Stage::kDone) return false;
    if (!frame.writer && frame.file) {
      frame.writer.emplace(frame.file, header_message(frame));
    } else if (!frame.writer) {
      frame.writer.emplace(frame.frame, header_message(frame));
    }
    if (frame.writer->next(outgoing_)) return true;
    ++answered_;
    frames_.pop_front();
    // A notice that waited for the end of this result.
    if (!notices_.empty()) return next_message();
  }
  return false;
}

std::string StreamCall::token(const SessionFrame& frame) {
  return backend_.keys.seal({.session = start_->session,
                             .epoch = epoch_,
                             .sequence = frame.sequence,
                             .exposure = told_,
                             .settings_hash = frame.settings_hash,
                             .tier = frame.tier},
                            absl::Now());
}

grpc::ByteBuffer StreamCall::header_message(const SessionFrame& frame) {
  told_ = frame.exposure;
  v1::StreamResponse response;
  v1::ResultHeader& header = *response.mutable_header();
  header = result_header(*frame.frame, {*frame.report, frame.queued}, backend_.device);
  header.set_tier_reason(frame.tier_reason);
  header.set_exposure_before(frame.exposure.before);
  header.set_cut(frame.exposure.cut);
  header.set_resume_token(token(frame));
  header.set_encoding(static_cast<v1::Encoding>(start_->encoding));
  if (frame.file) header.set_encoded_bytes(frame.file->size());
  return v1::pack(response);
}

grpc::ByteBuffer StreamCall::failure_message(const SessionFrame& frame) {
  if (!told_.is_of(frame.sequence)) told_.cut_pending |= frame.cut;
  v1::StreamResponse response;
  v1::FrameFailure& failure = *response.mutable_failure();
  failure.set_sequence(frame.sequence);
  failure.set_code(static_cast<uint32_t>(frame.failure.code()));
  failure.set_message(std::string(frame.failure.message()));
  failure.set_resume_token(token(frame));
  return v1::pack(response);
}

// Ends.

void StreamCall::go_away() {
  absl::MutexLock lock(&mutex_);
  if (finished_ || ending_) return;
  const absl::Status status =
      absl::UnavailableError("server is draining; go on with the session's last resume token on another one");
  if (!start_) return finish(status);
  v1::StreamResponse response;
  response.mutable_go_away()->set_reason("server is draining");
  notices_.push_back(v1::pack(response));
  read_no_more(status);
}

void StreamCall::give_up() {
  absl::MutexLock lock(&mutex_);
  if (!finished_) finish(absl::AbortedError("another call went on with this session"));
}

void StreamCall::OnCancel() {
  absl::MutexLock lock(&mutex_);
  if (!finished_) finish(absl::CancelledError("call was cancelled"));
}

// A frame that is being rendered already finishes, is discarded, and only then gives its memory back.
void StreamCall::drop(const FramePtr& frame) {
  const bool working = frame->stage == Stage::kQueued || frame->stage == Stage::kDrawing;
  if (working) backend_.loop.cancel(frame->ticket);
  if (working || frame->stage == Stage::kWaiting || frame->stage == Stage::kReceiving) {
    backend_.metrics.frame_ended(absl::StatusCode::kCancelled);
  }
  frame->stage = Stage::kFailed;
  frame->writer.reset();
  if (!working) frame->frame.reset();
}

void StreamCall::read_no_more(const absl::Status& status) {
  if (!start_ || absl::IsCancelled(status)) return finish(status);
  const bool receiving = !frames_.empty() && frames_.back()->stage == Stage::kReceiving;
  end_before(frames_.size() - (receiving ? 1 : 0), status);
  write_on();
}

void StreamCall::end_before(size_t first, const absl::Status& status) {
  if (!ending_) ending_ = status;
  state_ = Reading::kClosed;
  if (!plain()) {
    const auto undecided = std::find_if(frames_.begin(), frames_.end(), [](const FramePtr& frame) {
      return frame->stage == Stage::kQueued || frame->stage == Stage::kWaiting;
    });
    first = std::min(first, static_cast<size_t>(undecided - frames_.begin()));
  }
  while (frames_.size() > first) {
    drop(frames_.back());
    frames_.pop_back();
  }
}

void StreamCall::finish(const absl::Status& status) {
  finished_ = true;
  const grpc::Status told = to_grpc(status);
  log_event(LogLevel::kInfo, "session ended",
            {{"session", start_ ? start_->session : ""},
             {"peer", context_.peer()},
             {"answered", answered_},
             {"status", absl::StatusCodeToString(status.code())},
             {"message", told.error_message()}});
  if (start_) {
    backend_.sessions.leave(start_->session, this);
    backend_.metrics.session_ended();
  } else if (!inside_) {
    backend_.metrics.rejected(backend_.session_gate.closed() ? Rejection::kDraining : Rejection::kSessions);
  } else if (const std::optional<Rejection> reason = rejection_of(status)) {
    backend_.metrics.rejected(*reason);
  }
  for (const FramePtr& frame : frames_) drop(frame);
  frames_.clear();
  memory_alarm_.reset();
  backend_.lookahead_memory.change(std::exchange(promised_bytes_, 0), 0);
  if (inside_) watch_idle(backend_.idle_timeout);
  Finish(told);
}

void StreamCall::OnDone() {
  std::shared_ptr<StreamCall> self;  // outlives the lock
  bool inside = false;
  {
    absl::MutexLock lock(&mutex_);
    idle_alarm_.reset();
    inside = inside_;
    self = std::move(self_);
  }
  if (inside) backend_.session_gate.leave();
}

void StreamCall::watch_idle(absl::Duration wait) {
  idle_alarm_ = call_later(wait, weak_from_this(), &StreamCall::on_idle);
}

void StreamCall::on_idle() {
  absl::MutexLock lock(&mutex_);
  if (finished_) {
    // gRPC cannot even deliver the status, for the peer reads nothing. Its place is not kept for it. After
    // OnDone, which lets go of self_, there is no place to give up.
    if (self_ != nullptr && std::exchange(inside_, false)) {
      context_.TryCancel();
      backend_.session_gate.leave();
    }
    return;
  }
  const absl::Time now = absl::Now();
  const absl::Duration timeout = backend_.idle_timeout;
  // A write that nobody reads never ends by itself, and no status could follow it.
  if (writing_ && now - last_write_ >= timeout) return context_.TryCancel();
  if (state_ == Reading::kBands && now - frames_.back()->begun > kMaxUploadTimeouts * timeout) {
    return finish(absl::DeadlineExceededError(absl::StrFormat(
        "frame %d was not complete after %s, %d times this server's idle timeout; send it faster",
        frames_.back()->sequence, words(now - frames_.back()->begun), kMaxUploadTimeouts)));
  }
  const bool busy = writing_ || std::any_of(frames_.begin(), frames_.end(), [](const FramePtr& frame) {
                      return frame->stage != Stage::kReceiving && frame->stage != Stage::kWaiting;
                    });
  // Where it is full of frames that wait for others, nothing arrives either.
  const bool may_arrive = reading_ || state_ == Reading::kBetween;
  if (may_arrive && !busy && now - std::max(last_read_, last_write_) >= timeout) {
    return finish(absl::DeadlineExceededError(absl::StrFormat(
        "nothing arrived for %s, this server's idle timeout; send frames without such pauses, or resume",
        words(timeout))));
  }
  watch_idle(timeout / 2);
}

}  // namespace candela
