// The client's session, against servers that the tests run.
#include "client/session.h"

#include <grpcpp/create_channel.h>
#include <grpcpp/server_builder.h>
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <functional>
#include <iterator>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "absl/strings/str_format.h"
#include "absl/synchronization/notification.h"
#include "absl/time/clock.h"
#include "candela/v1/render.grpc.pb.h"
#include "client/call/duplex_call.h"
#include "client/call/raw_call.h"
#include "client/call/retry_schedule.h"
#include "client/retry.h"
#include "proto/candela/v1/message_wire.h"
#include "tests/support/clock.h"
#include "tests/support/status.h"

namespace candela {
namespace {

using Wire = grpc::ServerReaderWriter<v1::StreamResponse, v1::StreamRequest>;

// Answers each frame with an image of one value: 16 times the manual EV plus the sequence number. The resume
// token is the sequence number. Listens on a free TCP port while it exists.
class FakeServer : public v1::RenderService::Service {
 public:
  // Called with each frame's number before it is answered. A status other than OK ends the call with it, and
  // kEndsAsIfDone ends it with OK.
  using Fault = std::function<grpc::Status(uint64_t sequence, Wire& stream)>;
  static inline const grpc::Status kEndsAsIfDone{grpc::OUT_OF_RANGE, "as if done"};

  // Called with the number of opens before this one. A status other than OK refuses it.
  using OpenFault = std::function<grpc::Status(size_t opens)>;

  explicit FakeServer(Fault fault = nullptr, OpenFault open_fault = nullptr);
  ~FakeServer() override;

  std::string address() const;
  // The open messages so far.
  std::vector<v1::StreamOpen> opens();

  grpc::Status Stream(grpc::ServerContext* context, Wire* stream) override;

 private:
  const Fault fault_;
  const OpenFault open_fault_;
  int port_ = 0;
  std::unique_ptr<grpc::Server> server_;
  std::mutex mutex_;
  std::vector<v1::StreamOpen> opens_;
};

void answer(const v1::FrameHeader& frame, const v1::Settings& settings, Wire& stream) {
  v1::StreamResponse response;
  v1::ResultHeader& header = *response.mutable_header();
  header.set_sequence(frame.sequence());
  header.set_width(frame.width());
  header.set_height(frame.height());
  header.set_format(v1::OUTPUT_FORMAT_RGBA8);
  header.set_resume_token(absl::StrFormat("%d", frame.sequence()));
  stream.Write(response);
  response.mutable_band()->set_first_row(0);
  response.mutable_band()->set_pixels(std::string(
      size_t{frame.width()} * frame.height() * 4,
      static_cast<char>(16 * settings.exposure().manual_ev() + static_cast<double>(frame.sequence()))));
  stream.Write(response);
}

FakeServer::FakeServer(Fault fault, OpenFault open_fault)
    : fault_(std::move(fault)), open_fault_(std::move(open_fault)) {
  grpc::ServerBuilder builder;
  builder.AddListeningPort("127.0.0.1:0", grpc::InsecureServerCredentials(), &port_);
  builder.RegisterService(this);
  server_ = builder.BuildAndStart();
}

FakeServer::~FakeServer() { server_->Shutdown(std::chrono::system_clock::now()); }

std::string FakeServer::address() const { return absl::StrFormat("127.0.0.1:%d", port_); }

std::vector<v1::StreamOpen> FakeServer::opens() {
  const std::lock_guard lock(mutex_);
  return opens_;
}

grpc::Status FakeServer::Stream(grpc::ServerContext* context, Wire* stream) {
  v1::StreamRequest request;
  if (!stream->Read(&request) || !request.has_open()) return {grpc::INVALID_ARGUMENT, "no open"};
  const v1::StreamOpen open = request.open();
  if (context->client_metadata().find("x-session-id")->second != open.session()) {
    return {grpc::INVALID_ARGUMENT, "no x-session-id"};
  }
  size_t before = 0;
  {
    const std::lock_guard lock(mutex_);
    before = opens_.size();
    opens_.push_back(open);
  }
  if (open_fault_) {
    const grpc::Status status = open_fault_(before);
    if (!status.ok()) return status;
  }
  v1::StreamResponse opened;
  opened.mutable_opened()->set_session(open.session());
  opened.mutable_opened()->set_max_frames_in_flight(2);
  stream->Write(opened);
  std::map<uint64_t, v1::Settings> settings{{0, open.settings()}};
  while (stream->Read(&request)) {
    if (request.has_change()) {
      settings[request.change().from_sequence()] = request.change().settings();
      continue;
    }
    if (!request.has_frame()) return {grpc::INVALID_ARGUMENT, "no frame"};
    const v1::FrameHeader frame = request.frame();
    for (uint32_t rows = 0; rows < frame.height();) {
      if (!stream->Read(&request)) return {grpc::INVALID_ARGUMENT, "a frame is cut short"};
      if (request.band().first_row() != rows) return {grpc::INVALID_ARGUMENT, "rows are out of order"};
      rows += static_cast<uint32_t>(request.band().pixels().size() / (frame.width() * 8));
    }
    if (fault_) {
      const grpc::Status status = fault_(frame.sequence(), *stream);
      if (status.error_message() == kEndsAsIfDone.error_message()) return grpc::Status::OK;
      if (!status.ok()) return status;
    }
    answer(frame, std::prev(settings.upper_bound(frame.sequence()))->second, *stream);
  }
  return grpc::Status::OK;
}

// Servers that refuse a call because they are busy: a session's first open and retry() wait for them as they
// are told, and for nothing else.

using testing::VirtualClock;

// google.rpc.Status with a google.rpc.RetryInfo of half a second.
std::string half_a_second() {
  const std::string type = "type.googleapis.com/google.rpc.RetryInfo";
  const std::string info = std::string("\x0a\x06\x10\x80\xca\xb5\xee\x01", 8);
  const std::string any = "\x0a" + std::string(1, static_cast<char>(type.size())) + type + "\x12" +
                          std::string(1, static_cast<char>(info.size())) + info;
  return "\x08\x0e\x1a" + std::string(1, static_cast<char>(any.size())) + any;
}

grpc::Status full() { return {grpc::UNAVAILABLE, "server is full; try again soon", half_a_second()}; }

SessionOptions options_for(std::vector<std::string> servers, absl::Duration limit) {
  SessionOptions options;
  options.servers = std::move(servers);
  options.resume_limit = limit;
  return options;
}

TEST(FirstOpen, AServerThatIsFullIsWaitedForAsItSays) {
  FakeServer server(nullptr, [](size_t opens) { return opens < 2 ? full() : grpc::Status::OK; });
  SessionOptions options = options_for({server.address()}, absl::Seconds(20));
  std::atomic<int> waits = 0;
  options.on_open_wait = [&](const std::string& address, const absl::Status& why) {
    EXPECT_EQ(address, server.address());
    EXPECT_EQ(why.message(), "server is full; try again soon");
    ++waits;
  };
  const absl::Time begin = absl::Now();
  ASSERT_OK_AND_ASSIGN(const Session session, Session::open(options));
  EXPECT_GE(absl::Now() - begin, absl::Seconds(1));
  EXPECT_EQ(server.opens().size(), 3u);
  EXPECT_EQ(waits, 2);
  EXPECT_EQ(session.stats().resumes, 0u);
}

TEST(FirstOpen, ServersThatCannotBeReachedAreNotWaitedFor) {
  const absl::Time begin = absl::Now();
  EXPECT_REFUSED(kUnavailable, "",
                 Session::open(options_for({"127.0.0.1:1", "127.0.0.1:2"}, absl::Minutes(10))));
  EXPECT_LT(absl::Now() - begin, absl::Minutes(1));
}

// Refuses a session before it reads anything, as candelad does when it is full.
class RefusingServer : public v1::RenderService::Service {
 public:
  RefusingServer() {
    grpc::ServerBuilder builder;
    builder.AddListeningPort("127.0.0.1:0", grpc::InsecureServerCredentials(), &port_);
    builder.RegisterService(this);
    server_ = builder.BuildAndStart();
  }
  ~RefusingServer() override { server_->Shutdown(std::chrono::system_clock::now()); }

  std::shared_ptr<grpc::Channel> channel() const {
    return grpc::CreateChannel("127.0.0.1:" + std::to_string(port_), grpc::InsecureChannelCredentials());
  }
  grpc::Status Stream(grpc::ServerContext*, Wire*) override { return full(); }

 private:
  int port_ = 0;
  std::unique_ptr<grpc::Server> server_;
};

constexpr char kStream[] = "/candela.v1.RenderService/Stream";

TEST(Reached, ARefusalThatIsFasterThanTheFirstMessageIsOne) {
  const RefusingServer server;
  RawCall call(server.channel(), kStream, absl::InfiniteFuture());
  absl::SleepFor(absl::Milliseconds(100));  // the refusal is here
  EXPECT_FALSE(call.write(v1::pack(v1::StreamRequest())));
  EXPECT_EQ(call.finish().error_message(), full().error_message());
  EXPECT_TRUE(call.connected());
}

TEST(Reached, ASessionSeesItToo) {
  const RefusingServer server;
  CallQueue queue;
  DuplexCall call(queue, server.channel(), {"here"}, kStream, {});
  ASSERT_EQ(queue.next(), CallEvent::kWritable);
  absl::SleepFor(absl::Milliseconds(100));
  call.write(v1::pack(v1::StreamRequest()));
  while (queue.next() != CallEvent::kEnded) continue;
  EXPECT_EQ(call.status().error_message(), full().error_message());
  EXPECT_TRUE(call.connected());
}

// What a Connection returns for a server that is busy.
absl::Status refused(absl::Duration delay) {
  absl::Status status = absl::UnavailableError("full");
  set_retry_delay(status, delay);
  return status;
}

// retry() in virtual time.
absl::Status retry_in(VirtualClock& clock, const RetryOptions& options,
                      absl::FunctionRef<absl::Status(size_t server)> attempt) {
  const auto wait = [&clock](absl::Duration time) {
    clock.advance(time);
    return true;
  };
  return retry_by(clock, wait, 1, options, attempt);
}

TEST(Retry, ARefusalIsRepeatedAfterItsDelay) {
  VirtualClock clock;
  std::vector<absl::Time> calls;
  const absl::Status status = retry_in(clock, {}, [&](size_t server) {
    EXPECT_EQ(server, 0u);
    calls.push_back(clock.now());
    return calls.size() < 3 ? refused(absl::Seconds(3)) : absl::OkStatus();
  });
  EXPECT_OK(status);
  ASSERT_EQ(calls.size(), 3u);
  for (const absl::Duration wait : {calls[1] - calls[0], calls[2] - calls[1]}) {
    EXPECT_GE(wait, absl::Seconds(3));
    EXPECT_LE(wait, absl::Seconds(4.5));  // a crowd does not come back together
  }
}

TEST(Retry, InRealTimeToo) {
  const absl::Time begin = absl::Now();
  int calls = 0;
  const absl::Status status =
      retry(1, {}, [&](size_t) { return ++calls < 2 ? refused(absl::Milliseconds(30)) : absl::OkStatus(); });
  EXPECT_TRUE(status.ok()) << status;
  EXPECT_GE(absl::Now() - begin, absl::Milliseconds(30));
}

TEST(Retry, OtherErrorsAndUnreachableServersEndIt) {
  int calls = 0;
  const auto count = [&](const absl::Status& status) {
    calls = 0;
    return retry(2, {.limit = absl::Minutes(10)}, [&](size_t) {
      ++calls;
      return status;
    });
  };
  EXPECT_EQ(count(absl::InvalidArgumentError("no")), absl::InvalidArgumentError("no"));
  EXPECT_EQ(calls, 1);
  EXPECT_EQ(count(absl::UnavailableError("cannot reach")), absl::UnavailableError("cannot reach"));
  EXPECT_EQ(calls, 2);
}

// A server that was reached once may be starting again.
TEST(Retry, AServerThatGoesAwayIsLookedForUntilTheLimit) {
  VirtualClock clock;
  const absl::Time begin = clock.now();
  int calls = 0;
  const absl::Status status = retry_in(clock, {.limit = absl::Seconds(30)}, [&](size_t) {
    return ++calls == 1 ? refused(absl::ZeroDuration()) : absl::UnavailableError("cannot reach");
  });
  EXPECT_EQ(status.message(), "no server takes the call within 30s: full");
  EXPECT_GT(calls, 20);
  EXPECT_LT(clock.now() - begin, absl::Seconds(30));
  EXPECT_GT(clock.now() - begin, absl::Seconds(28.5));  // the longest pause is 1.5 s
}

absl::Status busy(size_t) { return refused(absl::Seconds(40)); }

TEST(Retry, ItDoesNotWaitBeyondItsDeadline) {
  VirtualClock clock;
  const absl::Time begin = clock.now();
  const absl::Status late =
      retry_in(clock, {.limit = absl::Minutes(5), .deadline = clock.now() + absl::Seconds(100)}, busy);
  EXPECT_TRUE(absl::IsUnavailable(late)) << late;
  EXPECT_GE(clock.now() - begin, absl::Seconds(40));
  EXPECT_LT(clock.now() - begin, absl::Seconds(100));
}

TEST(Retry, ItStopsWhenTold) {
  absl::Notification stop;
  std::thread stopper;
  const auto stop_soon = [&](size_t, const absl::Status&, absl::Duration) {
    stopper = std::thread([&stop] { stop.Notify(); });
  };
  const absl::Status stopped =
      retry(1, {.limit = absl::Minutes(5), .on_wait = stop_soon, .stop = &stop}, busy);
  stopper.join();
  EXPECT_TRUE(absl::IsCancelled(stopped)) << stopped;
}

TEST(RetrySchedule, PausesBetweenRoundsDoubleAndServersAreLeftAloneAsTheySay) {
  VirtualClock clock;
  RetrySchedule schedule(2, 7);
  const auto fail = [&](absl::Duration delay, bool progress = false) {
    schedule.failed(clock.now(), delay, progress);
    const absl::Duration pause = schedule.when() - clock.now();
    clock.advance(pause);
    return pause;
  };
  EXPECT_EQ(schedule.next(), 0u);
  EXPECT_EQ(fail(absl::ZeroDuration()), absl::ZeroDuration());
  EXPECT_EQ(schedule.next(), 1u);
  EXPECT_FALSE(schedule.round_over());
  for (const double least : {0.05, 0.1, 0.2, 0.4, 0.8, 1.0, 1.0}) {
    const absl::Duration pause = fail(absl::ZeroDuration());
    EXPECT_GE(pause, absl::Seconds(least));
    EXPECT_LE(pause, absl::Seconds(1.5 * least));
    EXPECT_TRUE(schedule.round_over());
    EXPECT_EQ(fail(absl::ZeroDuration()), absl::ZeroDuration());
  }
  EXPECT_LT(fail(absl::Seconds(60)), absl::Seconds(2));  // the other server is next
  EXPECT_GE(fail(absl::ZeroDuration(), /*progress=*/true), absl::Seconds(58));
  EXPECT_FALSE(schedule.round_over());
}

TEST(RetrySchedule, TheSameSeedGivesTheSamePauses) {
  const auto pause = [](uint32_t seed) {
    RetrySchedule schedule(1, seed);
    schedule.failed(absl::UnixEpoch(), absl::Seconds(1));
    return schedule.when() - absl::UnixEpoch();
  };
  EXPECT_EQ(pause(1000), pause(1000));
  EXPECT_NE(pause(1000), pause(2000));
}

// The client's session against servers that fail on demand, over real connections. Every result arrives once,
// in order. Its waits are tested in virtual time, see session_driver_test.cc.

constexpr uint32_t kWidth = 700, kHeight = 500;  // two bands

v1::Settings at_ev(double ev) {
  v1::Settings settings;
  settings.mutable_exposure()->set_manual_ev(ev);
  return settings;
}

SessionFrame frame(uint64_t sequence) {
  static const auto pixels = std::make_shared<std::vector<std::byte>>(size_t{kWidth} * kHeight * 8);
  return {.width = kWidth,
          .height = kHeight,
          .format = v1::PIXEL_FORMAT_RGBA16F,
          .pixels = *pixels,
          .owner = pixels,
          .sequence = sequence,
          .media_time_ns = static_cast<int64_t>(sequence) * 1000};
}

SessionOptions options_for(std::vector<std::string> servers) {
  SessionOptions options;
  options.servers = std::move(servers);
  options.settings = at_ev(1);
  options.resume_limit = absl::Minutes(1);
  return options;
}

// Streams `frames` frames, with an EV of 2 from frame `change` on, and takes their results.
struct Outcome {
  absl::Status status;
  std::vector<int> values;  // a byte of each result, in the order they came; -1 for a failure
  SessionStats stats;
};
Outcome run(const SessionOptions& options, uint64_t frames, uint64_t change = 1000) {
  Outcome run;
  absl::StatusOr<Session> session = Session::open(options);
  if (!session.ok()) return {session.status(), {}, {}};
  std::thread feeder([&] {
    for (uint64_t i = 0; i < frames; ++i) {
      if (i == change && !session->change_settings(i, at_ev(2)).ok()) return;
      if (!session->submit(frame(i)).ok()) return;
    }
    session->finish();
  });
  while (true) {
    absl::StatusOr<std::optional<FrameResult>> result = session->next_result();
    run.status = result.status();
    if (!result.ok() || !*result) break;
    const FrameResult& r = **result;
    EXPECT_EQ(r.sequence, run.values.size());
    run.values.push_back(r.status.ok() ? static_cast<int>(r.image.pixels().back()) : -1);
  }
  feeder.join();
  run.stats = session->stats();
  return run;
}

std::vector<int> expected(uint64_t frames, uint64_t change = 1000) {
  std::vector<int> values;
  for (uint64_t i = 0; i < frames; ++i) values.push_back(static_cast<int>((i >= change ? 32 : 16) + i));
  return values;
}

TEST(Session, ResultsComeOnceAndInOrder) {
  FakeServer server;
  const Outcome got = run(options_for({server.address()}), 12, 7);
  EXPECT_OK(got.status);
  EXPECT_EQ(got.values, expected(12, 7));
  EXPECT_EQ(got.stats.resumes, 0u);
  EXPECT_EQ(got.stats.window, 2u);
  EXPECT_EQ(got.stats.answered, 12u);
  EXPECT_EQ(server.opens().at(0).resume_token(), "");
}

TEST(Session, ALostServerIsReplacedByTheNextWithTheLastTokenAndItsSettings) {
  FakeServer first([](uint64_t sequence, Wire&) {
    return sequence == 6 ? grpc::Status(grpc::UNAVAILABLE, "dying") : grpc::Status::OK;
  });
  FakeServer second;
  for (const uint64_t change : {3, 6, 7}) {
    const size_t before = second.opens().size();
    const Outcome got = run(options_for({first.address(), second.address()}), 12, change);
    EXPECT_OK(got.status);
    EXPECT_EQ(got.values, expected(12, change));
    EXPECT_EQ(got.stats.resumes, 1u);
    EXPECT_GE(got.stats.sent_again, 1u);
    EXPECT_EQ(got.stats.server, second.address());
    const v1::StreamOpen open = second.opens().at(before);
    EXPECT_EQ(open.resume_token(), "5");
    EXPECT_EQ(open.settings().exposure().manual_ev(), change <= 5 ? 2 : 1);
  }
}

TEST(Session, ACallThatEndsTooEarlyWithoutAnErrorIsLost) {
  FakeServer first(
      [](uint64_t sequence, Wire&) { return sequence == 3 ? FakeServer::kEndsAsIfDone : grpc::Status::OK; });
  FakeServer second;
  const Outcome outcome = run(options_for({first.address(), second.address()}), 8);
  ASSERT_OK(outcome.status);
  EXPECT_EQ(outcome.values.size(), 8u);
  EXPECT_EQ(outcome.stats.resumes, 1u);
}

TEST(Session, AStateOpensItAndATokenTakesItsPlace) {
  const auto with_state = [](uint64_t sequence, Wire& stream) {
    v1::StreamResponse response;
    v1::ResultHeader& header = *response.mutable_header();
    header.set_sequence(sequence);
    header.set_width(kWidth);
    header.set_height(kHeight);
    header.set_encoding(v1::ENCODING_NONE);
    header.set_resume_token("token");
    header.mutable_state()->set_sequence(sequence);
    stream.Write(response);
    return grpc::Status(grpc::UNAVAILABLE, "dying");
  };
  // The first server dies before its first result, and the others after it.
  FakeServer first([](uint64_t, Wire&) { return grpc::Status(grpc::UNAVAILABLE, "dying"); });
  FakeServer second(with_state), third(with_state);
  SessionOptions options = options_for({first.address(), second.address(), third.address()});
  options.encoding = v1::ENCODING_NONE;
  options.state.emplace().set_sequence(7);
  options.state->set_exposure(0.3);
  ASSERT_OK_AND_ASSIGN(Session session, Session::open(options));
  EXPECT_REFUSED(kInvalidArgument, "", session.submit(frame(7))) << "the state is of frame 7";
  ASSERT_OK(session.submit(frame(8)));
  ASSERT_OK(session.submit(frame(9)));
  session.finish();
  for (const uint64_t sequence : {8, 9}) {
    ASSERT_OK_AND_ASSIGN(const std::optional<FrameResult> result, session.next_result());
    EXPECT_EQ(result->sequence, sequence);
    EXPECT_EQ(result->image.header.state().sequence(), sequence);
    EXPECT_EQ(result->image.bytes, 0u);
  }
  EXPECT_EQ(first.opens().at(0).state().exposure(), 0.3);
  EXPECT_EQ(second.opens().at(0).state().exposure(), 0.3) << "there was no token yet";
  EXPECT_TRUE(second.opens().at(0).return_state());
  EXPECT_FALSE(third.opens().at(0).has_state());
  EXPECT_EQ(third.opens().at(0).resume_token(), "token");
}

TEST(Session, AServerThatIsTooOldForStatesOrExposuresIsNotBelieved) {
  FakeServer server;
  SessionOptions options = options_for({server.address()});
  options.return_state = true;
  const Outcome stateless = run(options, 3);
  EXPECT_REFUSED(kUnimplemented, "older than this client", stateless.status);
  ASSERT_OK_AND_ASSIGN(Session session, Session::open(options_for({server.address()})));
  SessionFrame exposed = frame(0);
  exposed.exposure = 0.0;
  EXPECT_TRUE(absl::IsInvalidArgument(session.submit(exposed)));
  exposed.exposure = 0.3;
  ASSERT_OK(session.submit(exposed));
  session.finish();
  EXPECT_TRUE(absl::IsUnimplemented(session.next_result().status()));
}

TEST(Session, AServerThatGoesAwayIsLeftInPeace) {
  FakeServer first([](uint64_t sequence, Wire& stream) {
    if (sequence != 4) return grpc::Status::OK;
    v1::StreamResponse response;
    response.mutable_go_away()->set_reason("draining");
    stream.Write(response);
    return grpc::Status(grpc::UNAVAILABLE, "drained");
  });
  FakeServer second;
  const Outcome got = run(options_for({first.address(), second.address()}), 9);
  EXPECT_OK(got.status);
  EXPECT_EQ(got.values, expected(9));
  EXPECT_EQ(got.stats.resumes, 1u);
}

TEST(Session, AFrameThatFailsIsAResultOfItsOwn) {
  FakeServer server([](uint64_t sequence, Wire& stream) {
    // This is the last frame: the answer that follows is one too many, so the call ends here.
    if (sequence != 3) return grpc::Status::OK;
    v1::StreamResponse response;
    response.mutable_failure()->set_sequence(3);
    response.mutable_failure()->set_code(grpc::DEADLINE_EXCEEDED);
    response.mutable_failure()->set_message("late");
    response.mutable_failure()->set_resume_token("3");
    stream.Write(response);
    return grpc::Status(grpc::RESOURCE_EXHAUSTED, "enough");
  });
  const Outcome got = run(options_for({server.address()}), 9);
  EXPECT_EQ(got.values, (std::vector<int>{16, 17, 18, -1}));
  EXPECT_EQ(got.status, absl::ResourceExhaustedError("enough"));
}

TEST(Session, ARefusalEndsItAfterWhatCameBefore) {
  FakeServer server([](uint64_t sequence, Wire&) {
    return sequence == 2 ? grpc::Status(grpc::INVALID_ARGUMENT, "no such frame") : grpc::Status::OK;
  });
  const Outcome got = run(options_for({server.address()}), 9);
  EXPECT_EQ(got.values, expected(2));
  EXPECT_EQ(got.status, absl::InvalidArgumentError("no such frame"));
  EXPECT_EQ(got.stats.resumes, 0u);
}

// The other call may be this session's previous one, if its open message came late. Once that has results, it
// is another session's.
TEST(Session, ACallThatIsTakenOverBeforeAResultGoesOn) {
  std::atomic<int> times = 0;
  FakeServer server([&](uint64_t sequence, Wire&) {
    if (sequence == 2 && times == 0) return grpc::Status(grpc::UNAVAILABLE, (++times, "lost"));
    if (sequence == 2 && times == 1) return grpc::Status(grpc::ABORTED, (++times, "another call"));
    if (sequence == 5) return grpc::Status(grpc::ABORTED, "another call");
    return grpc::Status::OK;
  });
  const Outcome got = run(options_for({server.address()}), 9);
  EXPECT_EQ(got.values, expected(5));
  EXPECT_EQ(got.status, absl::AbortedError("another call"));
  EXPECT_EQ(got.stats.resumes, 2u);
}

// google.rpc.Status { details { google.rpc.RetryInfo { retry_delay { seconds: 0 .. 127, nanos: 0.5e9 } } } }
std::string retry_details(int seconds) {
  const std::string type = "type.googleapis.com/google.rpc.RetryInfo";
  const std::string delay{'\x08', static_cast<char>(seconds), '\x10', '\x80', '\xca', '\xb5', '\xee', '\x01'};
  const std::string info = "\x0a\x08" + delay;
  const std::string any = "\x0a" + std::string(1, static_cast<char>(type.size())) + type + "\x12" +
                          std::string(1, static_cast<char>(info.size())) + info;
  return "\x08\x0e\x1a" + std::string(1, static_cast<char>(any.size())) + any;
}

TEST(Session, RetryInfoIsReadWhereItIs) {
  const auto delay_of = [](const std::string& details) {
    return retry_delay(grpc::Status(grpc::UNAVAILABLE, "busy", details));
  };
  EXPECT_EQ(delay_of(retry_details(0)), absl::Milliseconds(500));
  EXPECT_EQ(delay_of(retry_details(3)), absl::Milliseconds(3500));
  EXPECT_EQ(delay_of(""), absl::ZeroDuration());
  EXPECT_EQ(delay_of("no message"), absl::ZeroDuration());
  EXPECT_EQ(delay_of(retry_details(3).substr(0, 40)), absl::ZeroDuration());
}

TEST(Session, AnotherServerIsAskedAtOnce) {
  FakeServer first([](uint64_t sequence, Wire&) {
    return sequence == 2 ? grpc::Status(grpc::UNAVAILABLE, "busy", retry_details(60)) : grpc::Status::OK;
  });
  FakeServer second;
  const Outcome got = run(options_for({first.address(), second.address()}), 5);
  EXPECT_OK(got.status);
  EXPECT_EQ(got.values, expected(5));
  EXPECT_EQ(got.stats.server, second.address());
}

// The connection is still good.
TEST(Session, AServerThatHangsIsLeftForTheNext) {
  absl::Notification over;
  FakeServer first([&](uint64_t sequence, Wire&) {
    if (sequence == 4) over.WaitForNotification();
    return grpc::Status::OK;
  });
  FakeServer second;
  SessionOptions options = options_for({first.address(), second.address()});
  options.silence_limit = absl::Seconds(3);
  const Outcome got = run(options, 9);
  over.Notify();
  EXPECT_OK(got.status);
  EXPECT_EQ(got.values, expected(9));
  EXPECT_EQ(got.stats.resumes, 1u);
  EXPECT_EQ(got.stats.server, second.address());
  EXPECT_EQ(second.opens().at(0).resume_token(), "3");
  EXPECT_TRUE(says(got.stats.last_loss.message(), "it hangs"));
}

TEST(Session, WithoutAnyServerItDoesNotOpen) {
  const Outcome got = run(options_for({"127.0.0.1:1", "127.0.0.1:2"}), 1);
  EXPECT_REFUSED(kUnavailable, "127.0.0.1:2", got.status);
  EXPECT_TRUE(absl::IsInvalidArgument(run(options_for({"nowhere"}), 1).status));
  EXPECT_TRUE(absl::IsInvalidArgument(run(options_for({}), 1).status));
}

TEST(Session, LeavingItAloneCancelsIt) {
  FakeServer server([](uint64_t, Wire&) {
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
    return grpc::Status::OK;
  });
  ASSERT_OK_AND_ASSIGN(Session session, Session::open(options_for({server.address()})));
  EXPECT_OK(session.submit(frame(0)));
  EXPECT_OK(session.submit(frame(1)));
  EXPECT_FALSE(session.ready());
}

TEST(Session, FramesOutOfOrderAreRefusedAndItGoesOn) {
  FakeServer server;
  ASSERT_OK_AND_ASSIGN(Session session, Session::open(options_for({server.address()})));
  EXPECT_OK(session.submit(frame(5)));
  EXPECT_TRUE(absl::IsInvalidArgument(session.submit(frame(5))));
  SessionFrame early = frame(6);
  early.media_time_ns = 0;
  EXPECT_TRUE(absl::IsInvalidArgument(session.submit(early)));
  SessionFrame small = frame(6);
  small.width = 1;
  EXPECT_TRUE(absl::IsInvalidArgument(session.submit(small)));
  EXPECT_TRUE(absl::IsInvalidArgument(session.change_settings(5, {})));
  for (int i = 0; i < 16; ++i) EXPECT_OK(session.change_settings(6, {}));
  EXPECT_TRUE(absl::IsFailedPrecondition(session.change_settings(6, {})));
  session.finish();
  EXPECT_TRUE(absl::IsFailedPrecondition(session.submit(frame(7))));
  absl::StatusOr<std::optional<FrameResult>> result = session.next_result();
  ASSERT_TRUE(result.ok() && *result) << result.status();
  EXPECT_EQ((**result).sequence, 5u);
  result = session.next_result();
  EXPECT_TRUE(result.ok() && !*result) << result.status();
}

}  // namespace
}  // namespace candela
