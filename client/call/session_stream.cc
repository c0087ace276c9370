#include "client/call/session_stream.h"

#include <algorithm>
#include <utility>
#include <variant>

#include "absl/strings/match.h"
#include "absl/strings/str_format.h"
#include "client/call/retry/retry_info.h"
#include "client/call/wire.h"
#include "proto/candela/v1/band_wire.h"
#include "proto/candela/v1/limits.h"
#include "proto/candela/v1/message_wire.h"
#include "proto/candela/v1/pixel_size.h"
#include "server/base/status_macros.h"

namespace candela {

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

}  // namespace candela
