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
#include "client/call/retry/retry_info.h"
#include "client/session.h"
#include "proto/candela/v1/message_wire.h"
#include "tests/support/status.h"
#include "tests/unit/client/fake_server.h"

namespace candela {
namespace {

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

TEST(FirstOpen, AnotherServerIsAskedAtOnceAndAFullOneAgain) {
  FakeServer server(nullptr, [](size_t opens) { return opens < 1 ? full() : grpc::Status::OK; });
  ASSERT_OK_AND_ASSIGN(const Session session,
                       Session::open(options_for({server.address(), "127.0.0.1:1"}, absl::Seconds(20))));
  EXPECT_EQ(session.stats().server, server.address());
}

TEST(FirstOpen, TheLimitHoldsAndZeroMeansOnce) {
  FakeServer server(nullptr, [](size_t) { return full(); });
  const absl::Time begin = absl::Now();
  EXPECT_REFUSED(kUnavailable, "within 2s: server is full",
                 Session::open(options_for({server.address()}, absl::Seconds(2))));
  EXPECT_GE(server.opens().size(), 2u);
  EXPECT_LT(absl::Now() - begin, absl::Seconds(10));
  const size_t before = server.opens().size();
  const absl::Status once = Session::open(options_for({server.address()}, absl::ZeroDuration())).status();
  EXPECT_EQ(once.message(), "server is full; try again soon");
  EXPECT_EQ(server.opens().size(), before + 1);
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
  DuplexCall call(server.channel(), kStream, {});
  ASSERT_EQ(call.wait(), DuplexCall::Event::kWritable);
  absl::SleepFor(absl::Milliseconds(100));
  call.write(v1::pack(v1::StreamRequest()));
  while (call.wait() != DuplexCall::Event::kEnded) continue;
  EXPECT_EQ(call.status().error_message(), full().error_message());
  EXPECT_TRUE(call.connected());
}

// What a Connection returns for a server that is busy.
absl::Status refused(absl::Duration delay) {
  absl::Status status = absl::UnavailableError("full");
  set_retry_delay(status, delay);
  return status;
}

TEST(Retry, ARefusalIsRepeatedAfterItsDelay) {
  std::vector<absl::Time> calls;
  EXPECT_OK(retry(1, {}, [&](size_t server) {
    EXPECT_EQ(server, 0u);
    calls.push_back(absl::Now());
    return calls.size() < 3 ? refused(absl::Milliseconds(300)) : absl::OkStatus();
  }));
  ASSERT_EQ(calls.size(), 3u);
  EXPECT_GE(calls[2] - calls[0], absl::Milliseconds(600));
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
  int calls = 0;
  const absl::Status status = retry(1, {.limit = absl::Seconds(1)}, [&](size_t) {
    return ++calls == 1 ? refused(absl::ZeroDuration()) : absl::UnavailableError("cannot reach");
  });
  EXPECT_EQ(status.message(), "no server takes the call within 1s: full");
  EXPECT_GT(calls, 2);
}

TEST(Retry, ItStopsWhenToldAndAtItsDeadline) {
  absl::Notification stop;
  std::thread stopper([&stop] {
    absl::SleepFor(absl::Milliseconds(200));
    stop.Notify();
  });
  const absl::Time begin = absl::Now();
  const auto busy = [](size_t) { return refused(absl::Seconds(40)); };
  const absl::Status stopped = retry(1, {.limit = absl::Minutes(5), .stop = &stop}, busy);
  stopper.join();
  EXPECT_REFUSED(kCancelled, "", stopped);
  EXPECT_REFUSED(kUnavailable, "",
                 retry(1, {.limit = absl::Minutes(5), .deadline = absl::Now() + absl::Seconds(1)}, busy));
  EXPECT_LT(absl::Now() - begin, absl::Seconds(20));
}

}  // namespace
}  // namespace candela
