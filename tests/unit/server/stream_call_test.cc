// Sessions without gRPC, sockets and threads: a StreamCall over a transport of the test's own.
#include "server/rpc/stream_call.h"

#include <gtest/gtest.h>

#include <deque>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "proto/candela/v1/message_wire.h"
#include "server/session/sessions.h"
#include "tests/support/clock.h"
#include "tests/support/status.h"

namespace candela::testing {
namespace {

// What happened is told by run().
class FakeTransport final : public CallTransport {
 public:
  void start_read(grpc::ByteBuffer* message) override { reading_ = message; }
  void start_write(const grpc::ByteBuffer* message) override { writing_ = message; }
  void finish(const grpc::Status& end) override { end_ = end; }
  void cancel() override { cancelled_ = true; }
  bool is_cancelled() const override { return cancelled_; }
  absl::Time deadline() const override { return absl::InfiniteFuture(); }
  std::string peer() const override { return "test"; }
  std::string identity(bool) const override { return "test"; }

  void begin(ServiceState& state) {
    call_ = StreamCall::begin(*this, state);
    run();
  }

  // The client's side.
  void send(const v1::StreamRequest& request) {
    sent_.push_back(v1::pack(request));
    run();
  }
  void half_close() {
    closed_ = true;
    run();
  }
  bool reads = true;
  std::vector<v1::StreamResponse> answers;
  std::optional<grpc::Status> status;  // once the call is done
  std::function<void()> before_done;

  void run() {
    while (happen()) {
    }
  }

 private:
  bool happen() {
    if (cancelled_ && !std::exchange(cancel_told_, true)) {
      call_->on_cancel();
    } else if (reading_ != nullptr && !sent_.empty() && !over()) {
      std::exchange(reading_, nullptr)->Swap(&sent_.front());
      sent_.pop_front();
      call_->on_read_done(true);
    } else if (reading_ != nullptr && (closed_ || over())) {
      reading_ = nullptr;
      call_->on_read_done(false);
    } else if (writing_ != nullptr && (reads || over())) {
      grpc::ByteBuffer message = *std::exchange(writing_, nullptr);
      if (!over()) {
        EXPECT_TRUE(v1::unpack(message, answers.emplace_back()));
      }
      call_->on_write_done(!over());
    } else if (end_ && reading_ == nullptr && writing_ == nullptr && call_ != nullptr) {
      if (before_done) before_done();
      status = end_;
      call_->on_done();
      call_.reset();
    } else {
      return false;
    }
    return true;
  }
  bool over() const { return cancelled_ || end_.has_value(); }

  std::shared_ptr<ServerCall> call_;
  std::deque<grpc::ByteBuffer> sent_;
  bool closed_ = false;
  bool cancelled_ = false;
  bool cancel_told_ = false;
  grpc::ByteBuffer* reading_ = nullptr;
  const grpc::ByteBuffer* writing_ = nullptr;
  std::optional<grpc::Status> end_;
};

class NoEncoders final : public WorkerPool {
 public:
  void run(std::function<void()>) override { ADD_FAILURE() << "nothing is rendered here"; }
};

// Keeps the callback of the newest timer.
class KeepingTimers final : public Timers {
 public:
  explicit KeepingTimers(Timers& timers) : timers_(timers) {}
  std::unique_ptr<Timer> call_after(absl::Duration wait, std::function<void()> then) override {
    newest = then;
    return timers_.call_after(wait, std::move(then));
  }
  std::function<void()> newest;

 private:
  Timers& timers_;
};

v1::StreamRequest open_message() {
  v1::StreamRequest request;
  request.mutable_open()->set_session("shot");
  return request;
}

v1::StreamRequest header(uint64_t sequence) {
  v1::StreamRequest request;
  v1::FrameHeader& frame = *request.mutable_frame();
  frame.set_sequence(sequence);
  frame.set_width(1);
  frame.set_height(1);
  frame.set_format(v1::PIXEL_FORMAT_RGBA16F);
  return request;
}

v1::StreamRequest band() {
  v1::StreamRequest request;
  request.mutable_band()->set_pixels(std::string(8, '\0'));
  return request;
}

// A server without a device: no frame gets as far as its memory.
class StreamCallTest : public ::testing::Test {
 protected:
  static constexpr absl::Duration kIdleTimeout = absl::Minutes(1);

  // The open message of a session that goes on after frame 5.
  v1::StreamRequest resume_message() const {
    v1::StreamRequest request = open_message();
    ResumePoint point;
    point.session = "shot";
    point.sequence = 5;
    point.exposure.begun = true;
    point.exposure.sequence = 5;
    point.settings_hash = stream_start_from(request.open())->settings.hash;
    request.mutable_open()->set_resume_token(state_.sessions.keys.seal(point, clock_now()));
    return request;
  }
  absl::Time clock_now() const { return state_.clock.now(); }
  void pass(absl::Duration time, FakeTransport& transport) {
    clock_.advance(time);
    transport.run();
  }

  VirtualClock clock_;
  KeepingTimers timers_{clock_};
  Metrics metrics_{"version", "device", "driver", "passes"};
  RenderSteps steps_{run_job, 8, clock_};
  NoEncoders encoders_;
  ServiceState state_{
      .clock = clock_,
      .timers = timers_,
      .rendering =
          {.renderer = nullptr, .loop = steps_, .encoders = encoders_, .device = "device", .bits = "bits"},
      .limits = {{.max_dimension = 8, .max_frame_bytes = 4096}, kIdleTimeout, /*max_frames_in_flight=*/2},
      .metrics = metrics_,
      .call_gate = CallGate("calls", 1),
      .session_gate = CallGate("sessions", 2),
      .sessions = {.keys = *TokenKeys::random(),
                   .memory = std::make_shared<ClientMemory>(1 << 20, 100, kIdleTimeout / 2)},
      .environments = EnvironmentStore(1 << 20)};
};

TEST_F(StreamCallTest, ASessionOpensAndEndsWithItsClient) {
  FakeTransport transport;
  transport.begin(state_);
  transport.send(open_message());
  ASSERT_EQ(transport.answers.size(), 1u);
  EXPECT_EQ(transport.answers[0].opened().session(), "shot");
  EXPECT_EQ(state_.session_gate.places_taken(), 1u);
  transport.half_close();
  ASSERT_TRUE(transport.status);
  EXPECT_OK(*transport.status);
  EXPECT_EQ(state_.session_gate.places_taken(), 0u);
}

TEST_F(StreamCallTest, AResumedSessionPassesOverWhatWasAnswered) {
  FakeTransport transport;
  transport.begin(state_);
  transport.send(resume_message());
  transport.send(header(3));
  EXPECT_EQ(transport.answers.size(), 1u) << "its pixels are not here";
  transport.send(band());
  ASSERT_EQ(transport.answers.size(), 2u);
  EXPECT_EQ(transport.answers[0].opened().epoch(), 1u);
  const v1::FrameFailure& answer = transport.answers[1].failure();
  EXPECT_EQ(answer.sequence(), 3u);
  EXPECT_EQ(answer.code(), static_cast<uint32_t>(absl::StatusCode::kAlreadyExists));
  const absl::StatusOr<ResumePoint> point =
      state_.sessions.keys.open(answer.resume_token(), "shot", clock_now());
  ASSERT_OK(point);
  EXPECT_EQ(point->sequence, 5u);
  EXPECT_EQ(point->epoch, 1u);
  transport.half_close();
  EXPECT_OK(*transport.status);
}

TEST_F(StreamCallTest, AnotherCallTakesTheSessionOver) {
  FakeTransport first;
  first.begin(state_);
  first.send(open_message());
  FakeTransport second;
  second.begin(state_);
  second.send(resume_message());
  first.run();
  ASSERT_TRUE(first.status);
  EXPECT_REFUSED(kAborted, "another call resumed this session", *first.status);
  EXPECT_EQ(second.answers.size(), 1u);
  second.half_close();
  EXPECT_OK(*second.status);
}

TEST_F(StreamCallTest, ADrainTellsTheSessionAndEndsWhenItHasLeft) {
  FakeTransport transport;
  transport.begin(state_);
  transport.send(open_message());
  transport.reads = false;
  std::optional<bool> drained;
  const auto drain = Drain::begin(state_.call_gate, state_.session_gate, state_.sessions.table,
                                  [&](bool all_left) { drained = all_left; });
  transport.run();
  EXPECT_EQ(drained, std::nullopt);
  transport.reads = true;
  transport.run();
  EXPECT_EQ(drained, true);
  EXPECT_TRUE(transport.answers.back().has_go_away());
  EXPECT_REFUSED(kUnavailable, "server is draining", *transport.status);
}

TEST_F(StreamCallTest, ASilentClientHasItsIdleTimeout) {
  FakeTransport transport;
  transport.begin(state_);
  transport.send(open_message());
  pass(kIdleTimeout - absl::Nanoseconds(1), transport);
  EXPECT_FALSE(transport.status);
  pass(2 * ClientMemory::kLookInterval, transport);
  ASSERT_TRUE(transport.status);
  EXPECT_REFUSED(kUnavailable, "nothing arrived for 1m", *transport.status);
}

TEST_F(StreamCallTest, AClientThatReadsNothingIsCutOff) {
  FakeTransport transport;
  transport.reads = false;
  transport.begin(state_);
  transport.send(open_message());
  pass(kIdleTimeout - absl::Nanoseconds(1), transport);
  EXPECT_FALSE(transport.is_cancelled());
  pass(2 * ClientMemory::kLookInterval, transport);
  EXPECT_TRUE(transport.is_cancelled());
  EXPECT_TRUE(transport.answers.empty());
  EXPECT_EQ(state_.session_gate.places_taken(), 0u);
}

// Nobody waits for a callback that runs when its timer is destroyed, and this one gets the mutex last.
TEST_F(StreamCallTest, ATimerThatFiresAtTheEndOfACallDoesNotCutItOff) {
  FakeTransport transport;
  transport.begin(state_);
  transport.send(open_message());
  const std::function<void()> late = timers_.newest;
  std::optional<bool> drained;
  const auto drain = Drain::begin(state_.call_gate, state_.session_gate, state_.sessions.table,
                                  [&](bool all_left) { drained = all_left; });
  transport.before_done = [&] {
    late();
    EXPECT_EQ(drained, std::nullopt) << "the client has not got its status";
  };
  transport.run();
  EXPECT_FALSE(transport.is_cancelled());
  EXPECT_EQ(drained, true);
  late();
  EXPECT_REFUSED(kUnavailable, "server is draining", *transport.status);
}

TEST_F(StreamCallTest, AFullServerRefusesAtOnce) {
  FakeTransport inside[2];
  for (FakeTransport& transport : inside) transport.begin(state_);
  FakeTransport late;
  late.begin(state_);
  ASSERT_TRUE(late.status);
  EXPECT_REFUSED(kUnavailable, "its limit", *late.status);
  for (FakeTransport& transport : inside) transport.half_close();
}

}  // namespace
}  // namespace candela::testing
