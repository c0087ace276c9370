// Calls that end early, and servers that stop early.
#include <grpcpp/create_channel.h>
#include <grpcpp/security/credentials.h>

#include <string>
#include <thread>
#include <vector>

#include "absl/time/clock.h"
#include "client/call/raw_call.h"
#include "client/call/retry_schedule.h"
#include "tests/service/server/busy_device.h"
#include "tests/service/service_fixture.h"
#include "tests/service/sessions/wire_cutter.h"
#include "tests/support/status.h"

namespace candela::testing {
namespace {

class CallLife : public ServiceTest {
 protected:
  const WireFrame frame_ = natural(640, 480);
};
INSTANTIATE_TEST_SUITE_P(Transport, CallLife, ::testing::Bool(), transport_name);

TEST_P(CallLife, CancelInTheMiddleOfTheBandsGivesTheMemoryBack) {
  OpenCall call(channel());
  call.write(start_of(frame_));
  call.write(band_of(frame_, 0, 100));
  ASSERT_TRUE(wait_until_in_use(connection()));
  call.context.TryCancel();
  EXPECT_EQ(call.finish().error_code(), grpc::CANCELLED);
  EXPECT_TRUE(wait_until_idle(connection()));
}

TEST_P(CallLife, CancelAtAnyMomentLeavesNothingBehind) {
  for (int i = 0; i < 60; ++i) {
    // In process, a call ends for its client before it ends for the server, which counts it until then.
    if (i % 4 == 0) {
      ASSERT_TRUE(wait_until_idle(connection()));
    }
    OpenCall call(channel());
    std::thread canceller([&call, i] {
      absl::SleepFor(absl::Microseconds(300 * i));
      call.context.TryCancel();
    });
    call.write(start_of(frame_));
    call.write(band_of(frame_, 0, 240));
    call.write(band_of(frame_, 240, 240));
    call.stream->WritesDone();
    const grpc::Status status = call.finish();
    canceller.join();
    EXPECT_TRUE(status.ok() || status.error_code() == grpc::CANCELLED) << status.error_message();
  }
  EXPECT_TRUE(wait_until_idle(connection()));
  EXPECT_OK(connection().render({}, view(frame_)));
}

TEST_P(CallLife, ADeadlineEndsTheCall) {
  OpenCall call(channel(), [](grpc::ClientContext& context) {
    context.set_deadline(std::chrono::system_clock::now() + std::chrono::milliseconds(100));
  });
  call.write(start_of(frame_));
  EXPECT_EQ(call.finish().error_code(), grpc::DEADLINE_EXCEEDED);
  EXPECT_TRUE(wait_until_idle(connection()));
}

TEST_P(CallLife, TheClientReportsItsOwnDeadlineInWords) {
  const BusyDevice device(server());  // so that no answer of the server's comes first
  EXPECT_REFUSED(kDeadlineExceeded, "time given",
                 connection().render({}, view(frame_), absl::Now() + absl::Milliseconds(50)));
}

TEST_P(CallLife, AClientThatDoesNotReadItsResultIsCutOffToo) {
  const WireFrame frame = natural(2048, 1024);
  v1::RenderRequest start = start_of(frame);
  // A result of 16 MiB, which is more than flow control allows unread.
  start.mutable_start()->mutable_settings()->set_output_format(v1::OUTPUT_FORMAT_RGBA16F);
  OpenCall call(channel());
  call.write(start);
  for (uint32_t y = 0; y < 1024; y += 128) call.write(band_of(frame, y, 128));
  call.stream->WritesDone();
  ASSERT_TRUE(wait_until_in_use(connection()));
  EXPECT_TRUE(wait_until_idle(connection()));
  EXPECT_FALSE(call.finish().ok());
}

TEST(CallLimit, CallsBeyondTheMostAtOnceAreToldToTryAgain) {
  Config config = test_config();
  config.idle_timeout = absl::Minutes(1);  // the calls stay open, even on a machine that stands still
  const std::unique_ptr<Server> server = start_server(config);
  const auto channel = own_channel(server->addresses().at(0));
  const Connection connection(channel);
  std::vector<std::unique_ptr<OpenCall>> calls;
  const auto open_another = [&] {
    calls.push_back(std::make_unique<OpenCall>(channel));
    calls.back()->stream->Write(start_of(natural(1, 1)));
  };
  for (uint32_t i = 0; i < config.max_calls; ++i) open_another();
  // They reach the server at different times, and one that comes beside a rendered frame is refused itself.
  absl::Status status;
  const absl::Time give_up = absl::Now() + absl::Seconds(10);
  while (status.ok() && absl::Now() < give_up) {
    status = connection.render({}, view(natural(4, 4))).status();
    if (status.ok()) open_another();
  }
  EXPECT_REFUSED(kUnavailable, "8 calls", status);
  EXPECT_GT(noted_retry_delay(status).value_or(absl::ZeroDuration()), absl::ZeroDuration());
  for (const auto& call : calls) {
    call->context.TryCancel();
    (void)call->finish();
  }
}

TEST(VanishedClient, GivesTheMemoryBackAndHurtsNobody) {
  const std::unique_ptr<Server> server = start_server(test_config());
  const Connection witness(server->in_process_channel());
  const WireFrame frame = natural(320, 480);
  for (uint32_t rows : {0u, 100u, 480u}) {
    WireCutter wire(server->addresses().at(0));
    OpenCall call(grpc::CreateChannel(wire.address(), grpc::InsecureChannelCredentials()));
    call.write(start_of(frame));
    if (rows > 0) {
      call.write(band_of(frame, 0, rows));
      ASSERT_TRUE(wait_until_in_use(witness));
    }
    if (rows == 480) call.stream->WritesDone();
    wire.cut();
    const grpc::Status status = call.finish();
    EXPECT_TRUE(rows == 480 || status.error_code() == grpc::UNAVAILABLE) << status.error_message();
    EXPECT_TRUE(wait_until_idle(witness));
    EXPECT_OK(witness.render({}, view(frame)));
  }
}

TEST(Drain, AFrameInFlightFinishesWhileNewCallsAreRefused) {
  const std::unique_ptr<Server> server = start_server(test_config());
  const auto channel = server->in_process_channel();
  const WireFrame frame = natural(16, 16);
  OpenCall call(channel);
  call.write(start_of(frame));
  call.write(band_of(frame, 0, 1));
  ASSERT_TRUE(wait_until_in_use(Connection(channel)));
  std::thread drain([&server] { server->drain_and_stop(); });
  absl::Status refused;
  while (refused.ok()) refused = Connection(channel).render({}, view(frame)).status();
  EXPECT_REFUSED(kUnavailable, "draining", refused);
  EXPECT_TRUE(absl::IsUnavailable(Connection(channel).health()));
  call.write(band_of(frame, 1, 15));
  call.stream->WritesDone();
  EXPECT_OK(call.finish());
  drain.join();
}

TEST(Drain, CallsThatOutlastTheDrainTimeoutAreCancelled) {
  Config config = test_config();
  config.drain_timeout = absl::Milliseconds(100);
  config.idle_timeout = absl::Minutes(1);
  const std::unique_ptr<Server> server = start_server(config);
  const auto channel = server->in_process_channel();
  OpenCall call(channel);
  const WireFrame frame = natural(16, 16);
  call.write(start_of(frame));
  call.write(band_of(frame, 0, 1));
  ASSERT_TRUE(wait_until_in_use(Connection(channel)));
  const absl::Time start = absl::Now();
  server->drain_and_stop();
  EXPECT_LT(absl::Now() - start, config.idle_timeout);
  EXPECT_FALSE(call.finish().ok());
}

// gRPC calls an answer done once it is written, and this one is on its way for a second longer.
TEST(Drain, AClientOnASlowConnectionGetsAllOfItsAnswer) {
  Config config = test_config();
  config.idle_timeout = absl::Minutes(1);
  const std::unique_ptr<Server> server = start_server(config);
  const Connection witness(server->in_process_channel());
  WireCutter wire(server->addresses().at(0));
  wire.slow_to_client(60e3);
  const WireFrame frame = natural(160, 160);
  OpenCall call(own_channel(wire.address()));
  call.write(start_of(frame));
  call.write(band_of(frame, 0, 1));
  ASSERT_TRUE(wait_until_in_use(witness));
  std::thread drain([&] {
    server->drain_and_stop();
    EXPECT_GE(wire.bytes_to_client(), 160u * 160 * 4);
  });
  while (witness.render({}, view(natural(1, 1))).ok()) {
  }
  call.write(band_of(frame, 1, 159));
  call.stream->WritesDone();
  EXPECT_OK(call.finish());
  drain.join();
}

// In the same process, a band is the server's memory. It stays valid while anybody holds it.
TEST(Drain, ABandOutlivesTheServerThatSentIt) {
  std::unique_ptr<Server> server = start_server(test_config());
  const WireFrame frame = flat(64, 64, {1, 1, 1, 1});
  const auto channel = server->in_process_channel();
  ASSERT_OK_AND_ASSIGN(const RenderResult expected, Connection(channel).render({}, view(frame)));
  grpc::ByteBuffer band;
  {
    RawCall call(channel, "/candela.v1.RenderService/Render", absl::InfiniteFuture());
    for (const v1::RenderRequest& request : {start_of(frame), band_of(frame, 0, 64)}) {
      const grpc::Slice bytes(request.SerializeAsString());
      ASSERT_TRUE(call.write(grpc::ByteBuffer(&bytes, 1)));
    }
    ASSERT_TRUE(call.half_close());
    ASSERT_TRUE(call.read(band));
    ASSERT_TRUE(call.read(band));
    ASSERT_OK(call.finish());
  }
  server.reset();
  std::vector<grpc::Slice> slices;
  ASSERT_OK(band.Dump(&slices));
  const grpc::Slice& pixels = slices.back();
  EXPECT_EQ(std::string(pixels.begin(), pixels.end()),
            std::string(reinterpret_cast<const char*>(expected.data.get()), expected.bytes));
}

}  // namespace
}  // namespace candela::testing
