// A server in virtual time: its limits are those of real ones, and nobody waits for them.
#include <atomic>
#include <functional>
#include <memory>
#include <string>
#include <thread>

#include "server/session/client_memory.h"
#include "tests/service/clients.h"
#include "tests/service/service_fixture.h"
#include "tests/support/clock.h"

namespace candela::testing {
namespace {

constexpr absl::Duration kMoment = absl::Nanoseconds(1);

Config long_limits() {
  Config config = test_config();
  config.listen = {};  // no sockets, and no thread that checks them in real time
  config.idle_timeout = absl::Minutes(1);
  config.pre_drain = absl::ZeroDuration();
  config.drain_timeout = absl::Hours(1);
  config.heartbeat_interval = absl::Hours(24);
  config.heartbeat_limit = absl::Hours(48);
  return config;
}

// The heartbeat waits by the clock, too.
constexpr int kHeartbeat = 1;
constexpr int kDrain = 1;

// A server, and a Render call to it.
class VirtualTime : public ::testing::Test {
 protected:
  void start(const Config& config) {
    config_ = config;
    server_ = start_server(config, clock_, clock_);
    ASSERT_NE(server_, nullptr);
    channel_ = server_->in_process_channel();
    stub_ = v1::RenderService::NewStub(channel_);
  }
  // It has memory, and the rest of the frame does not come.
  void begin_upload() {
    stream_ = stub_->Render(&context_);
    stream_->Write(start_of(frame_));
    stream_->Write(band_of(frame_, 0, 1));
    EXPECT_TRUE(wait_until_in_use(connection()));
  }
  // The server may note a moment too late when it last heard of a client, because gRPC's threads go on while
  // the clock is moved. So this may go beyond a limit that has to end something.
  void advance_until(const std::function<bool()>& ended) {
    int looks = 0;
    for (; looks < 10'000 && !ended(); ++looks) clock_.advance(ClientMemory::kLookInterval);
    ASSERT_LT(looks, 10'000);
  }
  // In steps, between which the server has real time to read what was sent.
  void pass(absl::Duration time) {
    for (int i = 0; i < 4; ++i) {
      clock_.advance(time / 4);
      (void)in_use();
    }
  }
  Connection connection() const { return Connection(channel_); }
  bool in_use() const { return connection().server_info()->pool().bytes_in_use() > 0; }
  grpc::Status finish() {
    v1::RenderResponse response;
    while (stream_->Read(&response)) {
    }
    return stream_->Finish();
  }
  absl::Status render() const { return connection().render({}, view(frame_)).status(); }

  VirtualClock clock_;
  const WireFrame frame_ = natural(16, 16);
  Config config_;
  std::unique_ptr<Server> server_;
  std::shared_ptr<grpc::Channel> channel_;
  std::unique_ptr<v1::RenderService::Stub> stub_;
  grpc::ClientContext context_;
  std::unique_ptr<grpc::ClientReaderWriter<v1::RenderRequest, v1::RenderResponse>> stream_;
};

TEST_F(VirtualTime, ACallThatSendsNothingEndsWithTheIdleTimeout) {
  ASSERT_NO_FATAL_FAILURE(start(long_limits()));
  stream_ = stub_->Render(&context_);
  clock_.wait_for_timers(1);  // the call is there
  clock_.advance(config_.idle_timeout);
  const grpc::Status status = finish();
  EXPECT_EQ(status.error_code(), grpc::DEADLINE_EXCEEDED);
  EXPECT_NE(status.error_message().find("nothing arrived for 1m, this server's idle timeout"),
            std::string::npos)
      << status.error_message();
}

TEST_F(VirtualTime, SoDoesOneThatSendsOnlyItsHeader) {
  ASSERT_NO_FATAL_FAILURE(start(long_limits()));
  stream_ = stub_->Render(&context_);
  stream_->Write(start_of(frame_));
  std::atomic<bool> ended = false;
  std::thread client([&] {
    EXPECT_EQ(finish().error_code(), grpc::DEADLINE_EXCEEDED);
    ended = true;
  });
  advance_until([&] {
    (void)in_use();  // real time for the server
    return ended.load();
  });
  client.join();
}

TEST_F(VirtualTime, AnUploadThatStopsKeepsItsMemoryUntilTheIdleTimeout) {
  ASSERT_NO_FATAL_FAILURE(start(long_limits()));
  begin_upload();
  clock_.advance(config_.idle_timeout - kMoment);
  EXPECT_TRUE(in_use());
  advance_until([&] { return !in_use(); });
  EXPECT_EQ(finish().error_code(), grpc::DEADLINE_EXCEEDED);
  EXPECT_TRUE(wait_until_idle(connection()));
}

TEST_F(VirtualTime, ACallThatKeepsSendingIsNotIdle) {
  ASSERT_NO_FATAL_FAILURE(start(long_limits()));
  begin_upload();
  for (uint32_t y = 1; y < 16; ++y) {
    pass(config_.idle_timeout / 2);
    ASSERT_TRUE(stream_->Write(band_of(frame_, y, 1))) << y;
  }
  stream_->WritesDone();
  EXPECT_TRUE(finish().ok());
}

TEST_F(VirtualTime, AFrameOfARowNowAndThenEndsAfterTenIdleTimeouts) {
  ASSERT_NO_FATAL_FAILURE(start(long_limits()));
  StreamClient client(channel_);
  const WireFrame large = natural(16, 64);
  ASSERT_TRUE(client.open("slow") && client.send_header(large, 0, 0));
  uint32_t rows = 0;
  for (; rows < 64 && client.send_rows(large, rows, 1); ++rows) pass(config_.idle_timeout / 2);
  EXPECT_GE(rows, 19u);
  const grpc::Status status = client.finish();
  EXPECT_EQ(status.error_code(), grpc::DEADLINE_EXCEEDED);
  EXPECT_NE(status.error_message().find("was not complete"), std::string::npos) << status.error_message();
}

TEST_F(VirtualTime, ASilentSessionIsToldToResumeNotBeforeTheIdleTimeout) {
  ASSERT_NO_FATAL_FAILURE(start(long_limits()));
  StreamClient client(channel_);
  ASSERT_TRUE(client.open("silent"));
  ASSERT_TRUE(client.send(frame_, 0, 0));
  StreamResult result;
  ASSERT_TRUE(client.read(result));
  const auto sessions = [&] { return connection().server_info()->sessions(); };
  clock_.advance(config_.idle_timeout - kMoment);
  EXPECT_EQ(sessions(), 1u);
  advance_until([&] { return sessions() == 0; });
  const grpc::Status status = client.finish();
  EXPECT_EQ(status.error_code(), grpc::UNAVAILABLE);
  EXPECT_NE(status.error_message().find("idle timeout; resume the session"), std::string::npos)
      << status.error_message();
}

TEST_F(VirtualTime, ThePreDrainTakesCallsWhileHealthAlreadyWarns) {
  Config config = long_limits();
  config.pre_drain = absl::Minutes(10);
  config.idle_timeout = absl::Hours(1);
  ASSERT_NO_FATAL_FAILURE(start(config));
  begin_upload();  // the server lives until it ends
  std::thread drain([this] { server_->drain_and_stop(); });
  clock_.wait_for_waiters(kHeartbeat + kDrain);
  EXPECT_FALSE(connection().health().ok());
  clock_.advance(config.pre_drain - kMoment);
  EXPECT_TRUE(render().ok());
  clock_.advance(kMoment);
  absl::Status status;
  while (status.ok()) status = render();
  EXPECT_TRUE(absl::IsUnavailable(status)) << status;
  stream_->Write(band_of(frame_, 1, 15));
  stream_->WritesDone();
  EXPECT_TRUE(finish().ok());
  drain.join();
}

TEST_F(VirtualTime, ACallThatOutlastsTheDrainTimeoutIsCancelledThen) {
  Config config = long_limits();
  config.drain_timeout = absl::Minutes(1);
  config.idle_timeout = absl::Hours(1);
  ASSERT_NO_FATAL_FAILURE(start(config));
  begin_upload();
  bool drained = false;
  std::thread drain([&] { server_->drain_and_stop([&drained] { drained = true; }); });
  clock_.wait_for_waiters(kHeartbeat + kDrain);
  clock_.advance(config.drain_timeout - kMoment);
  EXPECT_TRUE(in_use());
  clock_.advance(kMoment);
  EXPECT_FALSE(finish().ok());
  drain.join();
  EXPECT_FALSE(drained);
}

}  // namespace
}  // namespace candela::testing
