#include "client/session_driver.h"

#include <algorithm>
#include <utility>
#include <variant>

#include "absl/strings/match.h"
#include "absl/strings/str_format.h"
#include "client/call/channel.h"
#include "client/call/retry_schedule.h"
#include "proto/candela/v1/band_wire.h"
#include "proto/candela/v1/limits.h"
#include "proto/candela/v1/message_wire.h"
#include "proto/candela/v1/pixel_size.h"
#include "server/base/check.h"
#include "server/base/status_macros.h"

namespace candela {

SessionLog::SessionLog(v1::Settings settings, const std::optional<v1::SessionState>& state, bool raw)
    : raw_(raw), settings_(std::move(settings)) {
  if (!state) return;
  last_sequence_ = state->sequence();
  last_time_ns_ = state->media_time_ns();
}

absl::Status SessionLog::add(SessionFrame frame, absl::Time now) {
  RETURN_IF_ERROR(frame.view ? check_view(frame.width, frame.height, frame.pixels.size())
                             : check_frame(frame.width, frame.height, frame.format, frame.pixels.size()));
  if (last_sequence_ && frame.sequence <= *last_sequence_) {
    return absl::InvalidArgumentError(
        absl::StrFormat("frame %d comes after frame %d; the sequence numbers of a session must increase",
                        frame.sequence, *last_sequence_));
  }
  if (frame.media_time_ns < last_time_ns_ || frame.media_time_ns > v1::kMediaTimeNs.max) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "frame %d has media time %d ns; it must be at least the previous frame's, %d ns, and at most %d ns",
        frame.sequence, frame.media_time_ns, last_time_ns_, v1::kMediaTimeNs.max));
  }
  // Written so that NaN fails.
  if (frame.exposure &&
      !(*frame.exposure >= v1::kExposureLimit.min && *frame.exposure <= v1::kExposureLimit.max)) {
    return absl::InvalidArgumentError(
        absl::StrFormat("frame %d has the exposure %g; it must be between %g and %g", frame.sequence,
                        *frame.exposure, v1::kExposureLimit.min, v1::kExposureLimit.max));
  }
  last_sequence_ = frame.sequence;
  last_time_ns_ = frame.media_time_ns;
  const v1::Settings& settings = settings_of(frame.sequence);
  const v1::ImageSize image = v1::image_size(settings.output_size(), {frame.width, frame.height});
  const uint64_t bytes = image_bytes(settings, image);
  steps_.push_back({std::make_shared<const SessionFrame>(std::move(frame)), now, image, 0, {}, bytes});
  ++unanswered_;
  return absl::OkStatus();
}

absl::Status SessionLog::change(uint64_t from_sequence, const v1::Settings& settings) {
  const uint64_t least = std::max(last_sequence_ ? *last_sequence_ + 1 : 0, last_from_);
  if (from_sequence < least) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "cannot change settings from frame %d on; the first possible frame is %d", from_sequence, least));
  }
  const auto ahead = [this](const SessionStep& step) {
    return step.frame == nullptr && (!last_sequence_ || step.from_sequence > *last_sequence_);
  };
  if (std::count_if(steps_.begin(), steps_.end(), ahead) >= v1::kMaxPendingChanges) {
    return absl::FailedPreconditionError(absl::StrFormat(
        "%d changes of settings already wait for their frames; submit frames first", v1::kMaxPendingChanges));
  }
  last_from_ = from_sequence;
  steps_.push_back({nullptr, absl::InfinitePast(), {}, from_sequence, settings, 0});
  return absl::OkStatus();
}

uint64_t SessionLog::rewind() {
  const auto sent = std::count_if(steps_.begin(), steps_.begin() + static_cast<ptrdiff_t>(given_),
                                  [](const SessionStep& step) { return step.frame != nullptr; });
  given_ = 0;
  return static_cast<uint64_t>(sent);
}

const SessionStep* SessionLog::next() { return given_ == steps_.size() ? nullptr : &steps_[given_++]; }

std::map<std::string, std::shared_ptr<const Panorama>> SessionLog::panoramas() const {
  std::map<std::string, std::shared_ptr<const Panorama>> panoramas;
  for (const SessionStep& step : steps_) {
    if (step.frame == nullptr || !step.frame->view || step.frame->panorama == nullptr) continue;
    panoramas.emplace(step.frame->view->environment(), step.frame->panorama);
  }
  return panoramas;
}

uint64_t SessionLog::image_bytes(v1::ImageSize frame) const {
  const v1::Settings& settings = settings_of(last_sequence_ ? *last_sequence_ + 1 : 0);
  return image_bytes(settings, v1::image_size(settings.output_size(), frame));
}

uint64_t SessionLog::image_bytes(const v1::Settings& settings, v1::ImageSize image) const {
  const bool hdr = settings.transfer() == v1::TRANSFER_PQ || settings.transfer() == v1::TRANSFER_HLG;
  const v1::OutputFormat format = settings.output_format() != v1::OUTPUT_FORMAT_UNSPECIFIED
                                      ? settings.output_format()
                                  : hdr ? v1::OUTPUT_FORMAT_RGBA16
                                        : v1::OUTPUT_FORMAT_RGBA8;
  return raw_ ? uint64_t{image.width} * image.height * bytes_per_pixel(format) : 0;
}

const v1::Settings& SessionLog::settings_of(uint64_t sequence) const {
  const auto changes = [sequence](const SessionStep& step) {
    return step.frame == nullptr && step.from_sequence <= sequence;
  };
  const auto last = std::find_if(steps_.rbegin(), steps_.rend(), changes);
  return last == steps_.rend() ? settings_ : last->settings;
}

std::deque<SessionStep>::const_iterator SessionLog::first_frame() const {
  return std::find_if(steps_.begin(), steps_.end(),
                      [](const SessionStep& step) { return step.frame != nullptr; });
}

const SessionStep* SessionLog::due() const {
  const auto first = first_frame();
  return first == steps_.end() || static_cast<size_t>(first - steps_.begin()) >= given_ ? nullptr : &*first;
}

void SessionLog::answered(const std::string& token) {
  const auto frame = first_frame();
  CHECK(frame != steps_.end() && unanswered_ > 0);
  CHECK(static_cast<size_t>(frame - steps_.begin()) < given_);  // no answer comes before its frame
  const uint64_t sequence = frame->frame->sequence;
  steps_.erase(frame);
  --given_;
  --unanswered_;
  if (token.empty()) return;
  token_ = token;
  // Changes are in the order of their numbers, and those for this frame come before it.
  while (!steps_.empty() && steps_.front().frame == nullptr && steps_.front().from_sequence <= sequence) {
    settings_ = std::move(steps_.front().settings);
    steps_.pop_front();
    CHECK(given_ > 0);
    --given_;
  }
}

SessionState::SessionState(const SessionOptions& options, std::string server, Clock& clock,
                           std::function<void()> wake)
    : lookahead_(options.lookahead),
      clock_(clock),
      wake_(std::move(wake)),
      log_(options.settings, options.state,
           options.encoding == v1::ENCODING_RAW || options.encoding == v1::ENCODING_UNSPECIFIED) {
  stats_.server = std::move(server);
}

absl::Status SessionState::wait_until_open() const {
  const absl::MutexLock lock(&mutex_);
  const auto decided = [this]() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) { return was_open_ || ended_; };
  mutex_.Await(absl::Condition(&decided));
  return was_open_ ? absl::OkStatus() : end_;
}

absl::Status SessionState::submit(SessionFrame frame) {
  const absl::MutexLock lock(&mutex_);
  const auto may = [this]() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) { return may_submit(); };
  mutex_.Await(absl::Condition(&may));
  RETURN_IF_ERROR(still_taking());
  RETURN_IF_ERROR(log_.add(std::move(frame), clock_.now()));
  ++submitted_;
  wake_();
  return absl::OkStatus();
}

bool SessionState::ready() const {
  const absl::MutexLock lock(&mutex_);
  return may_submit();
}

absl::Status SessionState::change_settings(uint64_t from_sequence, const v1::Settings& settings) {
  const absl::MutexLock lock(&mutex_);
  RETURN_IF_ERROR(still_taking());
  RETURN_IF_ERROR(log_.change(from_sequence, settings));
  wake_();
  return absl::OkStatus();
}

void SessionState::finish() {
  const absl::MutexLock lock(&mutex_);
  finished_ = true;
  wake_();
}

void SessionState::cancel() {
  const absl::MutexLock lock(&mutex_);
  cancelled_ = true;
  wake_();
}

absl::StatusOr<std::optional<FrameResult>> SessionState::next_result() {
  const absl::MutexLock lock(&mutex_);
  const auto any = [this]() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) { return !results_.empty() || ended_; };
  mutex_.Await(absl::Condition(&any));
  if (results_.empty()) {
    if (!end_.ok()) return end_;
    return std::nullopt;
  }
  std::optional<FrameResult> result = std::move(results_.front());
  results_.pop_front();
  return result;
}

bool SessionState::result_ready() const {
  const absl::MutexLock lock(&mutex_);
  return !results_.empty() || ended_;
}

SessionStats SessionState::stats() const {
  const absl::MutexLock lock(&mutex_);
  SessionStats stats = stats_;
  stats.window = window_;
  stats.submitted = submitted_;
  stats.answered = submitted_ - log_.unanswered();
  if (lost_) stats.time_without_results += clock_.now() - *lost_;
  return stats;
}

uint64_t SessionState::image_bytes(v1::ImageSize frame) const {
  const absl::MutexLock lock(&mutex_);
  return log_.image_bytes(frame);
}

SessionState::Need SessionState::need(bool idle) {
  const absl::MutexLock lock(&mutex_);
  if (!needs_server()) return Need::kNotYet;
  if (idle && lost_) lost_ = clock_.now();  // until now no result was due
  return !was_open_ || !finished_ || log_.unanswered() > 0 ? Need::kCall : Need::kOver;
}

std::optional<SessionState::Start> SessionState::begin_call(const std::string& server) {
  const absl::MutexLock lock(&mutex_);
  stats_.server = server;
  if (cancelled_) return std::nullopt;
  sent_before_ = log_.rewind();
  return Start{log_.token(), log_.settings()};
}

SessionState::NextStep SessionState::next_step() {
  const absl::MutexLock lock(&mutex_);
  const SessionStep* step = log_.next();
  if (step == nullptr) return {.finished = finished_};
  return {.step = *step};
}

DueFrame SessionState::due_frame() const {
  const absl::MutexLock lock(&mutex_);
  const SessionStep* step = log_.due();
  return step == nullptr ? DueFrame() : DueFrame{step->frame, step->image};
}

bool SessionState::take_open(const v1::StreamOpened& opened) {
  const absl::MutexLock lock(&mutex_);
  window_ = std::max<uint32_t>(1, opened.max_frames_in_flight()) + lookahead_;
  if (was_open_) {
    ++stats_.resumes;
    stats_.sent_again += sent_before_;
  }
  was_open_ = true;
  if (!opened.bits().empty()) {
    stats_.mixed_bits |= !bits_.empty() && bits_ != opened.bits();
    bits_ = opened.bits();
  }
  if (log_.unanswered() > 0) return false;
  found_again();
  return true;
}

void SessionState::take_answer(FrameAnswer answer) {
  const absl::MutexLock lock(&mutex_);
  CHECK(log_.due() != nullptr && !ended_);
  const SessionStep& step = *log_.due();
  results_.push_back({step.frame->sequence, std::move(answer.status), std::move(answer.image),
                      clock_.now() - step.submitted});
  log_.answered(answer.token);
  CHECK(log_.unanswered() < submitted_);
  found_again();
}

std::map<std::string, std::shared_ptr<const Panorama>> SessionState::panoramas() const {
  const absl::MutexLock lock(&mutex_);
  return log_.panoramas();
}

bool SessionState::cancelled() const {
  const absl::MutexLock lock(&mutex_);
  return cancelled_;
}

bool SessionState::was_open() const {
  const absl::MutexLock lock(&mutex_);
  return was_open_;
}

bool SessionState::complete() const {
  const absl::MutexLock lock(&mutex_);
  return finished_ && log_.unanswered() == 0;
}

absl::Time SessionState::lose(const absl::Status& status) {
  const absl::MutexLock lock(&mutex_);
  stats_.last_loss = status;
  if (!lost_) lost_ = clock_.now();
  return *lost_;
}

void SessionState::end(const absl::Status& status) {
  const absl::MutexLock lock(&mutex_);
  CHECK(!ended_);
  ended_ = true;
  end_ = cancelled_ ? absl::CancelledError("the session was cancelled") : status;
  found_again();
}

// Frames that look-ahead holds back are not due.
bool SessionState::needs_server() const {
  return cancelled_ || !was_open_ || finished_ || log_.unanswered() > lookahead_;
}

bool SessionState::may_submit() const {
  return ended_ || finished_ || (log_.unanswered() < window_ && results_.size() < window_);
}

absl::Status SessionState::still_taking() const {
  if (ended_ && !end_.ok()) return end_;
  if (!finished_) return absl::OkStatus();
  return absl::FailedPreconditionError(
      "finish() was called on this session; open another one for more frames");
}

void SessionState::found_again() {
  if (!lost_) return;
  stats_.time_without_results += clock_.now() - *lost_;
  lost_.reset();
}

namespace {

// A server that does not answer the open message for this long is skipped.
constexpr absl::Duration kOpenLimit = absl::Seconds(10);

// Whether the transport or a stopping server is the reason, rather than something that this session asked
// for. `again`: the server may have opened the session on an earlier call.
bool may_resume(const grpc::Status& status, bool again) {
  switch (status.error_code()) {
    case grpc::UNAVAILABLE:
    case grpc::CANCELLED:
      return true;
    case grpc::ALREADY_EXISTS:
      // The server has not noticed yet that it lost us.
      return again;
    case grpc::INTERNAL:
      return absl::StrContains(status.error_message(), "RST_STREAM");
    case grpc::UNKNOWN:
      // gRPC's own words for a call that ended without the server's status. The second ones are for a call
      // that a proxy ended.
      return absl::StrContains(status.error_message(), "Stream removed") ||
             absl::StrContains(status.error_message(), "No status received");
    default:
      return false;
  }
}

uint64_t row_bytes(const SessionFrame& frame) {
  return uint64_t{frame.width} * bytes_per_pixel(frame.format);
}

// Those of the band that begins at `row`.
std::span<const std::byte> band_rows(const SessionFrame& frame, uint64_t row) {
  const uint64_t count = std::min<uint64_t>(rows_of_band(row_bytes(frame)), frame.height - row);
  return frame.pixels.subspan(row * row_bytes(frame), count * row_bytes(frame));
}

// `rows` of the frame, without a copy. gRPC may keep a message after its call has ended, so the slice keeps
// the frame.
grpc::Slice slice_of(const std::shared_ptr<const SessionFrame>& frame, std::span<const std::byte> rows) {
  const auto let_go = [](void* owner) { delete static_cast<std::shared_ptr<const SessionFrame>*>(owner); };
  return grpc::Slice(const_cast<std::byte*>(rows.data()), rows.size(), let_go,
                     new std::shared_ptr<const SessionFrame>(frame));
}

// A server that is too old for states would ignore one silently. Its results hold none, which shows it.
bool wants_state(const SessionOptions& options) { return options.return_state || options.state.has_value(); }

v1::FrameHeader header_of(const SessionFrame& frame) {
  v1::FrameHeader header;
  header.set_sequence(frame.sequence);
  header.set_width(frame.width);
  header.set_height(frame.height);
  if (frame.view) {
    *header.mutable_view() = *frame.view;
  } else {
    header.set_format(frame.format);
    header.set_total_bytes(frame.pixels.size());
  }
  header.set_media_time_ns(frame.media_time_ns);
  header.set_cut(frame.cut);
  if (frame.exposure) header.set_exposure(*frame.exposure);
  if (frame.timeout != absl::InfiniteDuration()) {
    header.set_timeout_ms(
        static_cast<uint32_t>(std::clamp<int64_t>(absl::ToInt64Milliseconds(frame.timeout), 1, UINT32_MAX)));
  }
  return header;
}

}  // namespace

SessionStream::SessionStream(std::unique_ptr<ClientCall> call, const std::string& address, bool asked_before,
                             SessionState::Start start, const SessionOptions& options,
                             const std::string& name, SessionState& state, SessionMemory& memory,
                             Clock& clock)
    : call_(std::move(call)),
      address_(address),
      options_(options),
      state_(state),
      memory_(memory),
      clock_(clock),
      reader_({.image = options.encoding != v1::ENCODING_NONE, .state = wants_state(options)}),
      asked_before_(asked_before),
      open_request_(open_message(std::move(start), name)),
      open_by_(clock.now() + kOpenLimit) {}

void SessionStream::on_event(CallEvent event) {
  if (event == CallEvent::kEnded) return;
  if (own_.status.ok()) {
    own_.status = take_event(event);
    own_.resume = event == CallEvent::kTimeout;
    if (!own_.status.ok()) call_->cancel();
  }
  if (event == CallEvent::kMessage) call_->read();
  if (!own_.status.ok() || !call_->can_write()) return;
  send_next();
  if (call_->writing()) last_progress_ = clock_.now();
}

absl::Time SessionStream::deadline() const {
  return own_.status.ok() ? silent_until() : absl::InfiniteFuture();
}

CallEnd SessionStream::end() const {
  CallEnd end = own_.status.ok() ? how_it_ended() : own_;
  // A server that takes no region of ours says so by ending the call. Only its own status has details.
  const bool refused = !call_->status().error_details().empty() && !leaving_;
  if (shared_ && !answered_ && own_.status.ok() && refused) memory_.give_up();
  end.progress = progress_;
  end.asked = asked_ && call_->connected();
  return end;
}

v1::StreamRequest SessionStream::open_message(SessionState::Start start, const std::string& name) const {
  v1::StreamRequest request;
  v1::StreamOpen& open = *request.mutable_open();
  open.set_session(name);
  *open.mutable_settings() = std::move(start.settings);
  if (start.token.empty() && options_.state) *open.mutable_state() = *options_.state;
  open.set_return_state(wants_state(options_));
  open.set_resume_token(std::move(start.token));
  open.set_lookahead(options_.lookahead);
  open.set_cut_threshold_ev(options_.cut_threshold_ev);
  open.set_encoding(options_.encoding);
  open.set_jpeg_quality(options_.jpeg_quality);
  return request;
}

// An error ends the call.
absl::Status SessionStream::take_event(CallEvent event) {
  switch (event) {
    case CallEvent::kTimeout:
      return hangs();
    case CallEvent::kWoken:
      return state_.cancelled() ? absl::CancelledError() : absl::OkStatus();
    case CallEvent::kMessage:
      last_progress_ = clock_.now();
      return take_message();
    case CallEvent::kWritable:
      last_progress_ = clock_.now();
      return absl::OkStatus();
    case CallEvent::kEnded:
      break;
  }
  return absl::OkStatus();
}

absl::Status SessionStream::take_message() {
  ASSIGN_OR_RETURN(StreamEvent event, reader_.read(call_->message(), due_frame()));
  if (const auto* opened = std::get_if<v1::StreamOpened>(&event)) {
    open_ = true;
    server_unpacks_ = opened->compact();
    if (state_.take_open(*opened)) progress_ = true;
  }
  if (std::holds_alternative<v1::GoAway>(event)) leaving_ = true;
  if (auto* answer = std::get_if<FrameAnswer>(&event)) {
    const uint64_t sequence = state_.due_frame().frame->sequence;
    if (!images_.empty() && images_.front().first == sequence) images_.pop_front();
    state_.take_answer(std::move(*answer));
    answered_ = true;
    progress_ = true;
    --owed_;
  }
  return absl::OkStatus();
}

DueFrame SessionStream::due_frame() const {
  DueFrame due = state_.due_frame();
  if (due.frame != nullptr && !images_.empty() && images_.front().first == due.frame->sequence) {
    due.place = images_.front().second;
  }
  return due;
}

// The time at which a server that stays silent counts as hanging. With look-ahead the server holds back the
// results of as many frames, until the half-close.
absl::Time SessionStream::silent_until() const {
  if (!open_) return open_by_;
  const int64_t held_back = closed_ ? 0 : options_.lookahead;
  const bool due = owed_ > held_back || call_->writing();
  return due ? last_progress_ + options_.silence_limit : absl::InfiniteFuture();
}

absl::Status SessionStream::hangs() const {
  return absl::UnavailableError(
      absl::StrFormat("no answer from %s within %s: it hangs%s", address_,
                      absl::FormatDuration(open_ ? options_.silence_limit : kOpenLimit),
                      open_ ? "" : " or is not a candelad"));
}

// Must not hold the state's lock, because finding out why TLS failed may take seconds.
CallEnd SessionStream::how_it_ended() const {
  const grpc::Status& status = call_->status();
  if (closed_ && state_.complete() && (status.ok() || may_resume(status, true))) return {absl::OkStatus()};
  if (status.ok()) {
    // A proxy that cuts the call short may end it like this too.
    const char* how = leaving_ ? " went away" : " ended before every frame had its result";
    return {.status = absl::UnavailableError(address_ + how), .resume = true, .reached = true};
  }
  // ABORTED: another call took the session over. Before the first result that may be this session's own
  // previous call, if its open message came late.
  const bool was_open = state_.was_open();
  const bool by_itself = status.error_code() == grpc::ABORTED && was_open && !answered_;
  // The open message took longer than the server's idle timeout.
  const bool late = status.error_code() == grpc::DEADLINE_EXCEEDED && !open_;
  return {call_->error(), by_itself || late || may_resume(status, was_open || asked_before_),
          retry_delay(status), false, call_->connected()};
}

// Starts the next write if there is something to send.
void SessionStream::send_next() {
  if (!asked_) {
    asked_ = true;
    return call_->write(v1::pack(open_request_));
  }
  if (!open_ || leaving_ || closed_) return;
  return sending_ != nullptr ? send_band() : send_step();
}

void SessionStream::send_step() {
  const SessionState::NextStep next = state_.next_step();
  if (!next.step) {
    closed_ = next.finished;
    if (closed_) call_->half_close();
    return;
  }
  v1::StreamRequest request;
  if (next.step->frame == nullptr) {
    request.mutable_change()->set_from_sequence(next.step->from_sequence);
    *request.mutable_change()->mutable_settings() = next.step->settings;
  } else {
    *request.mutable_frame() = header_of(*next.step->frame);
    if (place(*next.step, *request.mutable_frame()) || next.step->frame->view) {
      ++owed_;
    } else {
      sending_ = next.step->frame;
      compress_ = server_unpacks_ && (options_.transport == Transport::kZstd ||
                                      (options_.transport != Transport::kGrpc && pace_.next_frame()));
      request.mutable_frame()->set_may_leave_out_alpha(compress_);
    }
    row_ = band_ = 0;
  }
  call_->write(v1::pack(request));
}

// Names the places of the frame's pixels and its image, as far as they are in memory. Returns whether the
// pixels are.
bool SessionStream::place(const SessionStep& step, v1::FrameHeader& header) {
  const std::shared_ptr<SharedRegion> region = memory_.region();
  if (region == nullptr) return false;
  const bool has_alpha = with_alpha(step.frame->format) == step.frame->format;
  const std::optional<uint64_t> pixels = has_alpha ? region->offset_of(step.frame->pixels) : std::nullopt;
  SharedRegion::Area image = region->take(step.image_bytes);
  if (!pixels && image.bytes == nullptr) return false;
  shared_ = true;
  header.mutable_memory()->set_ticket(region->ticket());
  if (pixels) header.mutable_memory()->set_pixels_offset(*pixels);
  if (image.bytes != nullptr) {
    header.mutable_memory()->set_image_offset(image.offset);
    images_.emplace_back(step.frame->sequence, std::move(image));
  }
  return pixels.has_value();
}

void SessionStream::send_band() {
  const absl::Time now = clock_.now();
  const uint64_t rows = rows_of_band(row_bytes(*sending_));
  if (band_ > 0 && !compress_) pace_.wrote(band_ - 1, rows * row_bytes(*sending_), now - band_began_);
  call_->write(next_band());
  band_began_ = now;
  ++band_;
  row_ += rows;
  if (row_ < sending_->height) return;
  sending_.reset();
  ++owed_;
}

grpc::ByteBuffer SessionStream::next_band() {
  const std::span<const std::byte> rows = band_rows(*sending_, row_);
  const auto first = static_cast<uint32_t>(row_);
  if (compress_ && rows.size() <= v1::kMaxBandBytes) {
    if (!packer_) packer_.emplace();
    grpc::Slice packed = packer_->pack(rows, sending_->width, sending_->format);
    if (packed.size() < rows.size()) {
      return v1::make_band(v1::kStreamFrameBand, first, std::move(packed), v1::BandRows::kZstd);
    }
  }
  return v1::make_band(v1::kStreamFrameBand, first, slice_of(sending_, rows));
}

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
