#include "tests/unit/client/fake_calls.h"

#include <iterator>
#include <utility>

#include "proto/candela/v1/message_wire.h"
#include "server/base/check.h"

namespace candela {

std::unique_ptr<ClientCall> FakeServers::call(size_t server, const std::string&) {
  CHECK(call_now == nullptr);  // one call at a time
  auto call = std::make_unique<FakeCall>(*this, server);
  call_now = call.get();
  return call;
}

void FakeServers::put(size_t server, std::shared_ptr<const Panorama> panorama, absl::Time) {
  CHECK(!put_ && call_now == nullptr);
  put_ = [this, server, panorama = std::move(panorama)] {
    absl::StatusOr<v1::Environment> put = on_put(server, *panorama);
    if (put.ok()) environments[server].insert(put->id());
    return put;
  };
}

grpc::Status FakeServers::open(size_t server, const v1::StreamOpen& message) {
  opens.push_back({server, clock_.now(), message});
  return on_open(server);
}

bool FakeServers::pass_on(SessionDriver& driver) {
  if (put_) {
    driver.on_put(std::exchange(put_, nullptr)());
    return true;
  }
  const std::optional<CallEvent> event = call_now == nullptr ? std::nullopt : call_now->next();
  if (event) driver.on_event(*event);
  return event.has_value();
}

FakeSession::FakeSession(size_t count, SessionOptions wanted, testing::VirtualClock& time)
    : clock(time),
      options(std::move(wanted)),
      servers(count, clock),
      state(options, servers.address(0), clock, [this] { woken = true; }),
      driver(servers, options, name, state, memory, clock, 1) {}

bool FakeSession::step() {
  if (driver.ended()) return false;
  if (std::exchange(woken, false)) {
    driver.on_event(CallEvent::kWoken);
    return true;
  }
  if (servers.pass_on(driver)) return true;
  const absl::Time deadline = driver.deadline();
  if (deadline == absl::InfiniteFuture()) return false;
  if (deadline > clock.now()) clock.advance(deadline - clock.now());
  driver.on_event(CallEvent::kTimeout);
  return true;
}

void FakeSession::settle() {
  for (bool any = true; any && !driver.ended();) {
    any = std::exchange(woken, false);
    if (any) driver.on_event(CallEvent::kWoken);
    any |= servers.pass_on(driver);
  }
}

FakeCall::FakeCall(FakeServers& servers, size_t server) : servers_(servers), server_(server) {
  if (servers.unreachable.contains(server)) end_ = grpc::Status(grpc::UNAVAILABLE, "cannot reach");
}

void FakeCall::write(const grpc::ByteBuffer& message) {
  CHECK(can_write());
  writing_ = true;
  sent_ = message;
}

void FakeCall::half_close() {
  CHECK(can_write());
  writing_ = true;
  sent_.reset();
}

void FakeCall::read() {
  CHECK(!reading_);
  reading_ = true;
}

absl::Status FakeCall::error() const {
  return {static_cast<absl::StatusCode>(end_->error_code()), end_->error_message()};
}

void FakeCall::lose(const grpc::Status& status) {
  inbox_.clear();
  if (!end_) end_ = status;
}

std::optional<CallEvent> FakeCall::next() {
  if (!started_ || writing_) {
    if (std::exchange(writing_, false) && !end_) take();
    started_ = true;
    return CallEvent::kWritable;
  }
  if (!reading_) return std::nullopt;
  if (!inbox_.empty()) {
    message_ = std::move(inbox_.front());
    inbox_.pop_front();
    reading_ = false;
    return CallEvent::kMessage;
  }
  if (end_) return CallEvent::kEnded;
  return std::nullopt;
}

// The server reads what was sent.
void FakeCall::take() {
  connected_ = true;
  if (silent_) return;
  if (!sent_) {
    answer_held(0);
    if (!end_) end_ = grpc::Status::OK;
    return;
  }
  v1::StreamRequest request;
  CHECK(v1::unpack(*sent_, request));
  if (request.has_open()) {
    open_ = request.open();
    settings_[0] = open_.settings();
    act(servers_.open(server_, open_), [this] {
      v1::StreamResponse opened;
      opened.mutable_opened()->set_session(open_.session());
      opened.mutable_opened()->set_max_frames_in_flight(2);
      inbox_.push_back(v1::pack(opened));
    });
  } else if (request.has_change()) {
    settings_[request.change().from_sequence()] = request.change().settings();
  } else if (request.has_frame()) {
    frame_ = request.frame();
    if (frame_.has_view()) take_frame(frame_);
  } else {
    CHECK(request.has_band());
    take_frame(frame_);
  }
}

void FakeCall::take_frame(const v1::FrameHeader& frame) {
  if (frame.has_view() && !servers_.environments[server_].contains(frame.view().environment())) {
    end_ = grpc::Status(grpc::NOT_FOUND, "no environment " + frame.view().environment());
    return;
  }
  frames_.push_back(frame);
  answer_held(open_.lookahead());
}

// Answers the oldest frames, but not the last `but` ones.
void FakeCall::answer_held(size_t but) {
  while (frames_.size() > but && !end_ && !silent_) {
    const v1::FrameHeader frame = std::move(frames_.front());
    frames_.pop_front();
    act(servers_.on_frame(server_, frame.sequence()), [&] {
      v1::StreamResponse response;
      v1::ResultHeader& header = *response.mutable_header();
      header.set_sequence(frame.sequence());
      header.set_width(frame.width());
      header.set_height(frame.height());
      header.set_format(v1::OUTPUT_FORMAT_RGBA8);
      header.set_resume_token(std::to_string(frame.sequence()));
      inbox_.push_back(v1::pack(response));
      const v1::Settings& settings = std::prev(settings_.upper_bound(frame.sequence()))->second;
      const auto value =
          static_cast<char>(16 * settings.exposure().manual_ev() + static_cast<double>(frame.sequence()));
      response.mutable_band()->set_first_row(0);
      response.mutable_band()->set_pixels(std::string(size_t{frame.width()} * frame.height() * 4, value));
      inbox_.push_back(v1::pack(response));
    });
  }
}

void FakeCall::act(const grpc::Status& what, const std::function<void()>& well) {
  if (what.ok()) return well();
  silent_ = what.error_message() == FakeServers::kSilent.error_message();
  if (!silent_) end_ = what;
}

}  // namespace candela
