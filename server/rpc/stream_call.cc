#include "server/rpc/stream_call.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <utility>

#include "absl/hash/hash.h"
#include "absl/strings/str_format.h"
#include "proto/candela/v1/message_wire.h"
#include "server/base/log.h"
#include "server/base/status_macros.h"
#include "server/encode/image_file.h"
#include "server/rpc/band_reader.h"
#include "server/schedule/render_loop.h"
#include "server/session/resume_token.h"

namespace candela {

StreamAnswers::StreamAnswers(const TokenKeys& keys, const StreamStart& start, uint64_t epoch,
                             std::string device, Clock& clock)
    : keys_(keys),
      session_(start.session),
      epoch_(epoch),
      encoding_(start.encoding),
      return_state_(start.return_state),
      device_(std::move(device)),
      clock_(clock) {}

void StreamAnswers::notify(const v1::StreamResponse& notice) { notices_.push_back(v1::pack(notice)); }

bool StreamAnswers::next(SessionFrames& frames, grpc::ByteBuffer& message) {
  if (writer_) {
    if (writer_->next(message)) return true;
    writer_.reset();
    frames.pop();
  }
  if (!notices_.empty()) {
    message.Swap(&notices_.front());
    notices_.pop_front();
    return true;
  }
  const SessionFrames::EntryPtr due = frames.due();
  if (due == nullptr) return false;
  const ExposurePoint& exposure = frames.answer(*due);
  if (due->stage == SessionFrames::Stage::kFailed) {
    message = failure(*due, exposure);
    frames.pop();
    return true;
  }
  if (encoding_ == v1::ENCODING_NONE || due->frame->image_in_memory) {
    writer_.emplace(std::make_shared<const std::string>(), result(*due, exposure));
  } else if (due->file != nullptr) {
    writer_.emplace(due->file, result(*due, exposure));
  } else {
    writer_.emplace(due->frame, result(*due, exposure),
                    leaves_out_alpha(*due->frame, due->layout, *due->report));
  }
  return writer_->next(message);
}

std::string StreamAnswers::token(const SessionFrames::Entry& frame, const ExposurePoint& exposure) const {
  return keys_.seal({.session = session_,
                     .epoch = epoch_,
                     .sequence = frame.token_sequence,
                     .exposure = exposure,
                     .settings_hash = frame.settings_hash},
                    clock_.now());
}

grpc::ByteBuffer StreamAnswers::result(const SessionFrames::Entry& frame,
                                       const ExposurePoint& exposure) const {
  v1::StreamResponse response;
  v1::ResultHeader& header = *response.mutable_header();
  header = result_header(*frame.frame, frame.layout, {*frame.report, frame.queued}, device_);
  header.set_exposure_before(frame.exposure.before);
  header.set_cut(frame.exposure.cut);
  header.set_resume_token(token(frame, exposure));
  if (return_state_) *header.mutable_state() = state_of(exposure);
  header.set_encoding(encoding_);
  if (frame.file != nullptr) header.set_encoded_bytes(frame.file->size());
  header.set_alpha_left_out(encoding_ == v1::ENCODING_RAW &&
                            leaves_out_alpha(*frame.frame, frame.layout, *frame.report));
  return v1::pack(response);
}

grpc::ByteBuffer StreamAnswers::failure(const SessionFrames::Entry& frame,
                                        const ExposurePoint& exposure) const {
  v1::StreamResponse response;
  v1::FrameFailure& failure = *response.mutable_failure();
  failure.set_sequence(frame.sequence);
  failure.set_code(static_cast<uint32_t>(frame.failure.code()));
  failure.set_message(std::string(frame.failure.message()));
  failure.set_resume_token(token(frame, exposure));
  return v1::pack(response);
}

StreamCall::Open::Open(OpenedSession opened, const ServiceState& state, ClientId client)
    : session(std::move(opened)),
      settings(session.start.settings, session.start.encoding,
               [memory = state.sessions.memory, client](uint64_t bytes) {
                 return memory->claim_table(client, bytes);
               }),
      frames(session.start.lookahead, session.start.cut_threshold_ev, session.point.exposure,
             state.limits.max_frames_in_flight, session.start.draws(), session.resumed_at()),
      answers(state.sessions.keys, session.start, session.epoch, state.rendering.device, state.clock) {
  if (session.resumed) settings.resume(session.point.sequence);
}

std::shared_ptr<ServerCall> StreamCall::begin(CallTransport& transport, ServiceState& state) {
  std::shared_ptr<StreamCall> call(new StreamCall(transport, state));
  call->start();
  return call;
}

StreamCall::StreamCall(CallTransport& transport, ServiceState& state)
    : ServerCall(transport, state, state.session_gate),
      state_(state),
      flow_(state.sessions.next_flow.fetch_add(2)),
      client_(absl::HashOf(transport.identity(state.limits.tokens))),
      admission_(*this, state, client_),
      last_read_(clock_.now()),
      last_write_(last_read_) {}

void StreamCall::on_entered() {
  visit_.emplace(state_.sessions.memory->presence(), client_);
  watch_idle(std::min(idle_timeout() / 2, ClientMemory::kLookInterval));
  read_on();
}

// Reading.

void StreamCall::read_on() {
  if (ending() || read_pending_) return;
  const bool wanted = reading_ == Reading::kOpen || reading_ == Reading::kFirstBand ||
                      reading_ == Reading::kBands || reading_ == Reading::kPassing ||
                      (reading_ == Reading::kBetween && open_->frames.has_room());
  if (!wanted) return;
  read_pending_ = true;
  last_read_ = clock_.now();
  transport_.start_read(&incoming_);
}

void StreamCall::on_read_done(bool ok) {
  absl::MutexLock lock(&mutex_);
  read_pending_ = false;
  if (ending()) return;
  last_read_ = clock_.now();
  if (ok) state_.metrics.bytes_in(incoming_.Length());
  grpc::ByteBuffer message;  // because the next read may begin before this message is processed
  message.Swap(&incoming_);
  const bool between = ok && reading_ == Reading::kBetween;
  const absl::Status status = ok ? take_message(message) : take_half_close();
  if (!status.ok()) return between ? refuse(status) : read_no_more(status);
  read_on();
}

absl::Status StreamCall::take_message(grpc::ByteBuffer& message) {
  if (reading_ == Reading::kBands) return take_band(message);
  if (reading_ == Reading::kPassing) return take_passed(message);
  if (reading_ == Reading::kFirstBand) {
    first_band_.Swap(&message);
    admit();
    return absl::OkStatus();
  }
  v1::StreamRequest request;
  RETURN_IF_ERROR(parse_request(message, request));
  if (reading_ == Reading::kOpen) return take_open(request);
  if (request.has_frame()) return take_header(request.frame());
  if (request.has_change()) return open_->settings.add(request.change());
  return absl::InvalidArgumentError(request.has_band() ? "a band came, but the frame before "
                                                         "it has every row; send `frame` first"
                                                       : "message holds neither `frame` nor `change`");
}

absl::Status StreamCall::take_open(const v1::StreamRequest& request) {
  if (!request.has_open()) {
    return absl::InvalidArgumentError("first message holds no `open`; send it before the frames");
  }
  absl::StatusOr<OpenedSession> opened = open_session(request.open(), clock_.now(), state_.sessions, self());
  if (!opened.ok()) return opened.status();
  if (const auto previous = std::move(opened->previous)) previous->give_up();
  // The gate closed before this session was in the table, so go_away() was not called.
  if (state_.session_gate.closed()) {
    state_.sessions.table.leave(opened->start.session, this);
    return absl::UnavailableError("server is draining and takes no new sessions; use another one");
  }
  open_.emplace(*std::move(opened), state_, client_);
  const OpenedSession& session = open_->session;
  state_.metrics.session_began();
  log_event(LogLevel::kInfo, session.resumed ? "session resumed" : "session opened",
            {{"session", session.start.session}, {"peer", transport_.peer()}, {"epoch", session.epoch}});
  v1::StreamResponse response;
  response.mutable_opened()->set_session(session.start.session);
  response.mutable_opened()->set_max_frames_in_flight(state_.limits.max_frames_in_flight);
  response.mutable_opened()->set_epoch(session.epoch);
  response.mutable_opened()->set_bits(state_.rendering.bits);
  response.mutable_opened()->set_compact(true);
  open_->answers.notify(response);
  reading_ = Reading::kBetween;
  write_on();
  return absl::OkStatus();
}

absl::Status StreamCall::take_header(const v1::FrameHeader& header) {
  sequence_ = header.sequence();
  ASSIGN_OR_RETURN(const WireLayout layout, wire_layout_from(header, state_.limits.frame));
  if (open_->frames.passes_over(header.sequence())) return pass_over(header, layout);
  SettingsTrack& settings = open_->settings;
  settings.advance(header.sequence());
  const SessionSettings& asked = settings.now();
  RETURN_IF_ERROR(check_settings_for(asked.settings, layout.desc, state_.limits.frame.max_dimension));
  const StreamStart& start = open_->session.start;
  const bool draws = start.draws();
  const v1::Settings& drawn = *asked.settings;
  ASSIGN_OR_RETURN(shared_, client_pixels_from(header, layout, image_size(drawn, layout.desc),
                                               drawn.output_format(), transport_.straight_from_this_host(),
                                               start.encoding == v1::ENCODING_RAW, state_.regions));
  // A frame that is not drawn gives its memory back before it waits for later ones.
  Admission::Request request{
      .desc = layout.desc,
      .sequence = header.sequence(),
      .settings = draws ? asked.settings : asked.settings.for_metering(/*histogram=*/false),
      .flow = flow_,
      .lookahead = draws ? start.lookahead : 0,
      .patience = idle_timeout()};
  if (header.has_view()) {
    RETURN_IF_ERROR(check_primaries_for_view(asked.settings));
    if (absl::Status status = use_view(header.view(), environment_, state_, request); !status.ok()) {
      return status;
    }
    environment_ = request.environment;
  }
  if (absl::Status status =
          open_->frames.add(header, layout, asked.settings->exposure(), asked.hash, clock_.now());
      !status.ok()) {
    return status;
  }
  RETURN_IF_ERROR(admission_.expect(std::move(request)));
  if (has_no_bands(header)) {
    admit();
    return absl::OkStatus();
  }
  bands_.emplace(v1::kStreamFrameBand, layout, clock_,
                 [this](absl::Duration took) { state_.rendering.loop.charge(flow_, took); });
  reading_ = Reading::kFirstBand;
  return absl::OkStatus();
}

void StreamCall::on_admitted(absl::StatusOr<std::shared_ptr<Frame>> admitted) {
  if (!admitted.ok()) return refuse(admitted.status());
  Entry& entry = *open_->frames.newest();
  entry.frame = *std::move(admitted);
  entry.begun = clock_.now();
  if (shared_) {
    entry.frame->image_in_memory = shared_->image != nullptr;
    entry.frame->memory.share(*std::exchange(shared_, std::nullopt));
  }
  if (!bands_) return take_without_bands();
  reading_ = Reading::kBands;
  grpc::ByteBuffer band;
  band.Swap(&first_band_);
  if (absl::Status status = take_band(band); !status.ok()) return read_no_more(status);
  read_on();
}

// The newest frame has its memory, and nothing more of it comes.
void StreamCall::take_without_bands() {
  reading_ = Reading::kBetween;
  if (absl::Status status = submit(open_->frames.newest(), open_->frames.first_work()); !status.ok()) {
    return read_no_more(status);
  }
  read_on();
}

absl::Status StreamCall::take_band(grpc::ByteBuffer& message) {
  const EntryPtr entry = open_->frames.newest();
  FrameMemory& memory = entry->frame->memory;
  absl::Status status = bands_->read(message, [&memory](uint32_t y) { return memory.input_row(y); });
  if (!status.ok() || !bands_->complete()) return status;
  bands_.reset();
  reading_ = Reading::kBetween;
  return submit(entry, open_->frames.first_work());
}

absl::Status StreamCall::take_half_close() {
  // gRPC reports a client that vanished as one that half-closed.
  if (transport_.is_cancelled()) return absl::CancelledError("call was cancelled");
  if (reading_ == Reading::kOpen) {
    return absl::InvalidArgumentError("call was half-closed before its open message");
  }
  if (bands_) return bands_->check_complete();
  reading_ = Reading::kClosed;
  open_->frames.close();
  RETURN_IF_ERROR(submit_decided());
  write_on();
  return absl::OkStatus();
}

// Writing.

void StreamCall::on_write_done(bool ok) {
  absl::MutexLock lock(&mutex_);
  write_pending_ = false;
  outgoing_.Clear();  // it would hold the memory of the frame until the next write
  if (finished()) return;
  if (!ok) return finish(absl::CancelledError("client went away before it had its results"));
  last_write_ = clock_.now();
  write_on();
}

void StreamCall::write_on() {
  if (finished() || write_pending_) return;
  if (open_->answers.next(open_->frames, outgoing_)) {
    write_pending_ = true;
    last_write_ = clock_.now();
    state_.metrics.bytes_out(outgoing_.Length());
    transport_.start_write(&outgoing_);
  } else if (open_->frames.empty() && reading_ == Reading::kClosed) {
    return finish(ending_.value_or(absl::OkStatus()));
  }
  read_on();
}

// Ending.

void StreamCall::go_away() {
  absl::MutexLock lock(&mutex_);
  if (ending()) return;
  const absl::Status status = absl::UnavailableError(
      "server is draining; resume the session with its last resume token on another one");
  if (!open_) return finish(status);
  v1::StreamResponse response;
  response.mutable_go_away()->set_reason("server is draining");
  open_->answers.notify(response);
  read_no_more(status);
}

void StreamCall::give_up() {
  absl::MutexLock lock(&mutex_);
  if (!finished()) finish(absl::AbortedError("another call resumed this session"));
}

void StreamCall::refuse(const absl::Status& status) {
  if (const std::optional<Rejection> reason = rejection_of(status)) state_.metrics.rejected(*reason);
  read_no_more(status);
}

void StreamCall::read_no_more(const absl::Status& status) {
  if (!open_ || absl::IsCancelled(status)) return finish(status);
  end_without(open_->frames.end_after_received(), status);
  write_on();
}

void StreamCall::end_without(const SessionFrames::Entries& dropped, const absl::Status& status) {
  if (!ending_) ending_ = status;
  reading_ = Reading::kClosed;
  admission_.cancel();
  release(dropped, status);
}

void StreamCall::release(const SessionFrames::Entries& dropped, const absl::Status& status) {
  for (const EntryPtr& entry : dropped) {
    if (entry->frame != nullptr && entry->unfinished()) state_.metrics.frame_ended(status.code());
    if (entry->submitted()) {
      state_.rendering.loop.cancel(entry->ticket);
    } else {
      entry->frame.reset();
    }
  }
}

void StreamCall::log_failure(const Entry& entry, const absl::Status& status) {
  log_event(LogLevel::kInfo, "frame failed",
            {{"session", open_->session.start.session},
             {"sequence", entry.sequence},
             {"peer", transport_.peer()},
             {"status", absl::StatusCodeToString(status.code())},
             {"message", status.message()}});
}

void StreamCall::on_finish(const absl::Status& status, const std::string& message) {
  log_event(LogLevel::kInfo, "session ended",
            {{"session", open_ ? open_->session.start.session : ""},
             {"peer", transport_.peer()},
             {"sequence", sequence_},
             {"answered", open_ ? open_->frames.answered() : 0},
             {"status", absl::StatusCodeToString(status.code())},
             {"message", message}});
  if (open_) {
    state_.sessions.table.leave(open_->session.start.session, this);
    state_.metrics.session_ended();
    open_->answers.end();
    release(open_->frames.drop_all(), status);
  } else if (!inside()) {
    state_.metrics.rejected(state_.session_gate.closed() ? Rejection::kDraining : Rejection::kSessions);
  } else if (const std::optional<Rejection> reason = rejection_at_open(status)) {
    state_.metrics.rejected(*reason);
  }
  admission_.end();
  first_band_.Clear();
  shared_.reset();
  environment_.reset();
  visit_.reset();
}

namespace {

// A stream's frames on their way in: when they get memory, which are passed over, and when they take too
// long.

std::string to_words(absl::Duration duration) {
  return absl::FormatDuration(absl::Trunc(duration, absl::Milliseconds(1)));
}

}  // namespace

void StreamCall::admit() {
  reading_ = Reading::kAdmission;
  admission_.begin([this](absl::StatusOr<std::shared_ptr<Frame>> admitted)
                       ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) { on_admitted(std::move(admitted)); });
}

absl::Status StreamCall::pass_over(const v1::FrameHeader& header, const WireLayout& layout) {
  open_->frames.add_passed(header.sequence(), layout, open_->settings.now().hash);
  if (has_no_bands(header)) {
    end_passed();
    return absl::OkStatus();
  }
  bands_.emplace(v1::kStreamFrameBand, layout, clock_);
  open_->frames.newest()->begun = clock_.now();
  reading_ = Reading::kPassing;
  return absl::OkStatus();
}

absl::Status StreamCall::take_passed(grpc::ByteBuffer& message) {
  absl::Status status = bands_->pass(message);
  if (!status.ok() || !bands_->complete()) return status;
  bands_.reset();
  end_passed();
  return absl::OkStatus();
}

void StreamCall::end_passed() {
  reading_ = Reading::kBetween;
  SessionFrames::passed(*open_->frames.newest());
  write_on();
}

void StreamCall::on_idle() {
  const absl::Time now = clock_.now();
  const absl::Duration timeout = idle_timeout();
  // A write that nobody reads never ends, and no status could follow it.
  if (write_pending_ && now - last_write_ >= timeout) return transport_.cancel();
  if (reading_ == Reading::kBands || reading_ == Reading::kPassing) {
    const Entry& entry = *open_->frames.newest();
    const absl::Status slow =
        check_upload_time(absl::StrFormat("frame %d", entry.sequence), now - entry.begun);
    if (!slow.ok()) return give_up_on_client(slow);
  }
  if (reading_ == Reading::kBands) {
    const Entry& entry = *open_->frames.newest();
    const absl::Status yield = state_.sessions.memory->check_upload(client_, entry.frame->memory.bytes(),
                                                                    now - entry.begun, now - last_read_, now);
    if (!yield.ok()) {
      read_no_more(yield);
      if (finished()) return;
    }
  }
  const bool busy = write_pending_ || (open_ && open_->frames.busy());
  // If the session is full of frames that wait for later ones, nothing is read, and that is idle too.
  const bool may_arrive = read_pending_ || reading_ == Reading::kBetween;
  if (may_arrive && !busy && now - std::max(last_read_, last_write_) >= timeout) {
    return give_up_on_client(idle_for(timeout));
  }
  watch_idle(std::min(timeout / 2, ClientMemory::kLookInterval));
}

void StreamCall::give_up_on_client(const absl::Status& status) {
  if (open_) release(open_->frames.drop_all(), absl::CancelledError());
  finish(status);
}

// A session that paused may go on with its token; a call that never became one has none.
absl::Status StreamCall::idle_for(absl::Duration timeout) const {
  if (!open_) {
    return absl::DeadlineExceededError(absl::StrFormat(
        "nothing arrived for %s, this server's idle timeout; send the open message", to_words(timeout)));
  }
  return absl::UnavailableError(
      absl::StrFormat("nothing arrived for %s, this server's idle timeout; resume the session with its last "
                      "resume token when there is a frame to send",
                      to_words(timeout)));
}

namespace {

// A stream's frames once they are received: metered, drawn and encoded.

PictureView picture_of(const FrameMemory& memory, bool wide) {
  const std::span<const std::byte> first = memory.output_row(0);
  const uint32_t height = memory.image().height;
  return {.width = memory.image().width,
          .height = height,
          .wide = wide,
          .rows = first.data(),
          .row_stride_bytes =
              height == 1 ? first.size() : static_cast<size_t>(memory.output_row(1).data() - first.data())};
}

}  // namespace

absl::Status StreamCall::submit(const EntryPtr& entry, Work work) {
  FrameJob job{.frame = entry->frame, .work = work, .flow = flow_};
  // A frame that took part in the exposure of others is rendered even if it is late.
  if (work != Work::kDraw) job.deadline = entry->deadline;
  if (work == Work::kRender) {
    // The render thread does not wait for mutex_, under which messages are read.
    job.decide = [self = self(), entry, frames = &open_->frames](const FrameStats& stats) {
      return frames->decide(*entry, stats);
    };
  } else if (work == Work::kDraw) {
    job.decide = [exposed = entry->exposure.exposed](const FrameStats&) { return exposed; };
  }
  job.done = [self = self(), entry, work](absl::StatusOr<RenderedFrame> rendered) {
    self->on_worked(entry, work, std::move(rendered));
  };
  ASSIGN_OR_RETURN(const Ticket ticket, state_.rendering.loop.submit(std::move(job)));
  SessionFrames::submitted(*entry, work, ticket);
  return absl::OkStatus();
}

absl::Status StreamCall::submit_decided() {
  while (const EntryPtr entry = open_->frames.next_decided()) {
    if (!open_->session.start.draws()) {
      state_.metrics.frame_ended(absl::StatusCode::kOk);
      ++state_.rendering.frames_rendered;
      continue;
    }
    RETURN_IF_ERROR(submit(entry, Work::kDraw));
  }
  return absl::OkStatus();
}

void StreamCall::on_worked(const EntryPtr& entry, Work work, absl::StatusOr<RenderedFrame> rendered) {
  if (rendered.ok()) count_stages(state_.metrics, *rendered);
  if (rendered.ok() && work != Work::kMeter) ++state_.rendering.frames_rendered;
  // These outlive the lock, because freeing a frame's memory takes time.
  std::shared_ptr<Frame> freed;
  FrameMemory freed_memory;
  absl::MutexLock lock(&mutex_);
  if (entry->dropped) {
    freed = std::move(entry->frame);
    return;
  }
  absl::Status status = rendered.status();
  if (!status.ok()) log_failure(*entry, status);
  if (rendered.ok() && work == Work::kMeter) {
    open_->frames.metered(*entry, *std::move(rendered));
    if (!open_->session.start.draws()) freed_memory = std::move(entry->frame->memory);
    status = submit_decided();
  } else if (rendered.ok()) {
    on_rendered(entry, *std::move(rendered));
  } else if (open_->frames.fail(*entry, status)) {
    freed = std::move(entry->frame);
    state_.metrics.frame_ended(status.code());
    status = submit_decided();
  }
  if (!status.ok()) end_without(open_->frames.end_before(*entry), status);
  write_on();
}

void StreamCall::on_rendered(const EntryPtr& entry, RenderedFrame rendered) {
  const StreamStart& start = open_->session.start;
  const bool encode = start.encoding != v1::ENCODING_RAW;
  SessionFrames::rendered(*entry, std::move(rendered), encode);
  if (!encode) return state_.metrics.frame_ended(absl::StatusCode::kOk);
  state_.rendering.encoders.run([self = self(), entry, image = entry->frame,
                                 opaque = entry->report->plan.resolve.opaque, shown = entry->report->shown,
                                 gain = entry->report->plan.gain, encoding = start.encoding,
                                 quality = start.jpeg_quality] {
    const absl::Time begin = self->clock_.now();
    const v1::Settings& settings = *image->settings;
    const bool wide = settings.output_format() == v1::OUTPUT_FORMAT_RGBA16;
    ImageFacts facts;
    if (shown) {
      const double peak = settings.peak_nits();
      facts.hdr = hdr_display(settings, shown->largest * peak, shown->mean * peak);
    }
    if (gain) facts.gain_map_max_log2 = gain->max_log2();
    absl::StatusOr<std::string> file =
        encode_image(picture_of(image->memory, wide), settings, facts, opaque, encoding, quality);
    if (file.ok()) image->memory.replace_output(file->size());
    self->on_encoded(entry, std::move(file), self->clock_.now() - begin);
  });
}

void StreamCall::on_encoded(const EntryPtr& entry, absl::StatusOr<std::string> file, absl::Duration took) {
  absl::MutexLock lock(&mutex_);
  if (entry->dropped) return;
  if (!file.ok()) {
    log_failure(*entry, file.status());
    end_without(open_->frames.end_before(*entry), file.status());
  } else {
    SessionFrames::encoded(*entry, *std::move(file), took);
    state_.metrics.stage("encode", took);
    state_.metrics.frame_ended(absl::StatusCode::kOk);
  }
  write_on();
}

}  // namespace candela
