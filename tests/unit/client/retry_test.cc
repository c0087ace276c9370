// Servers that refuse a call because they are busy: a session's first open and retry() wait for them as they
// are told, and for nothing else.
#include "client/retry.h"

#include <grpcpp/create_channel.h>
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <memory>
#include <string>
#include <thread>

#include "absl/time/clock.h"
#include "client/call/duplex_call.h"
#include "client/call/raw_call.h"
#include "client/call/retry_schedule.h"
#include "client/session.h"
#include "proto/candela/v1/message_wire.h"
#include "tests/support/clock/virtual_clock.h"
#include "tests/support/status.h"
#include "tests/unit/client/fake_server.h"

namespace candela {
namespace {

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

}  // namespace
}  // namespace candela
