// The loss of the Vulkan device, which the tests simulate.
#include <atomic>

#include "absl/time/clock.h"
#include "tests/service/server/scrape.h"
#include "tests/service/service_fixture.h"
#include "tests/service/sessions/session_run.h"
#include "tests/service/sessions/stream_client.h"
#include "tests/support/status.h"

namespace candela::testing {
namespace {

std::string pixels(const RenderResult& result) {
  return std::string(reinterpret_cast<const char*>(result.data.get()), result.bytes);
}

TEST(DeviceLost, TheFrameIsToldUnavailableAndTheNextOneHasTheSameBits) {
  const std::unique_ptr<Server> server = start_server(test_config());
  const Connection connection(server->in_process_channel());
  const WireFrame frame = natural(320, 240);
  ASSERT_OK_AND_ASSIGN(const RenderResult before, connection.render({}, view(frame)));
  server->lose_device();
  const absl::Status lost = connection.render({}, view(frame)).status();
  EXPECT_REFUSED(kUnavailable, "device lost", lost);
  ASSERT_OK_AND_ASSIGN(const RenderResult after, connection.render({}, view(frame)));
  EXPECT_EQ(pixels(before), pixels(after));
  EXPECT_TRUE(wait_until_idle(connection));
  EXPECT_EQ(server->validation_messages(), 0u);
}

// The old device is destroyed with the last of its frames.
TEST(DeviceLost, AFrameOnTheOldDeviceFailsAndHurtsNobody) {
  Config config = test_config();
  config.idle_timeout = absl::Minutes(1);  // its client waits for the new device
  const std::unique_ptr<Server> server = start_server(config);
  const auto channel = server->in_process_channel();
  const Connection connection(channel);
  const WireFrame frame = natural(64, 64);
  OpenCall call(channel);
  call.write(start_of(frame));
  call.write(band_of(frame, 0, 32));
  while (connection.server_info()->pool().bytes_in_use() == 0) absl::SleepFor(absl::Milliseconds(2));
  server->lose_device();
  EXPECT_TRUE(absl::IsUnavailable(connection.render({}, view(frame)).status()));
  EXPECT_OK(connection.render({}, view(frame)));
  // Its memory can still be written.
  call.write(band_of(frame, 32, 32));
  call.stream->WritesDone();
  EXPECT_EQ(call.finish().error_code(), grpc::UNAVAILABLE);
  EXPECT_OK(connection.render({}, view(frame))) << "a frame of the old device lost the new one";
}

double rebuilds(const Server& server) { return scrape(server).at("candela_device_rebuilds_total"); }

// A server with a fast heartbeat and a metrics port.
std::unique_ptr<Server> start_with_heartbeat(absl::Duration limit) {
  Config config = test_config();
  config.heartbeat_interval = absl::Milliseconds(100);
  config.heartbeat_limit = limit;
  config.metrics = "127.0.0.1:0";
  return start_server(config);
}

// Returns after `most` at the latest.
void wait_for_rebuild(const Server& server, absl::Duration most) {
  const absl::Time end = absl::Now() + most;
  while (rebuilds(server) < 1 && absl::Now() < end) absl::SleepFor(absl::Milliseconds(20));
}

// The server notices without a frame from a client.
TEST(DeviceLost, TheHeartbeatFindsOutBeforeAnyFrame) {
  const std::unique_ptr<Server> server = start_with_heartbeat(absl::Seconds(10));
  const Connection connection(server->in_process_channel());
  server->lose_device();
  wait_for_rebuild(*server, absl::Seconds(30));
  EXPECT_OK(connection.health());
  EXPECT_OK(connection.render({}, view(natural(16, 16))));
}

// After a process ran out of descriptors, some drivers allocate nothing until their device is opened again.
TEST(DeviceLost, ADeviceThatRendersNothingForTooLongIsReplaced) {
  const std::unique_ptr<Server> server = start_with_heartbeat(absl::Seconds(1));
  const Connection connection(server->in_process_channel());
  server->refuse_device_memory();
  EXPECT_REFUSED(kResourceExhausted, "", connection.render({}, view(natural(640, 480))));
  wait_for_rebuild(*server, absl::Seconds(60));
  const absl::Time end = absl::Now() + absl::Seconds(60);
  while (!connection.health().ok() && absl::Now() < end) absl::SleepFor(absl::Milliseconds(20));
  EXPECT_OK(connection.health());
  EXPECT_OK(connection.render({}, view(natural(640, 480))));
  EXPECT_EQ(rebuilds(*server), 1);
}

TEST(DeviceLost, TheFramesOfAStreamEndWithItAndItsTokenGoesOn) {
  const std::unique_ptr<Server> server = start_server(test_config());
  const auto channel = server->in_process_channel();
  const Film frames = make_film(6, 160, 90);
  const std::vector<WireFrame>& film = *frames;
  const std::vector<StreamResult> whole = stream_all(channel, open_of("whole"), film);
  ASSERT_EQ(whole.size(), film.size());
  StreamClient client(channel);
  ASSERT_TRUE(client.open("lost"));
  StreamResult last, next;
  for (size_t i = 0; i < 3; ++i) {
    ASSERT_TRUE(client.send(film[i], i, film_time_ns(i)) && client.read(last));
  }
  server->lose_device();
  client.send(film[3], 3, film_time_ns(3));
  client.send(film[4], 4, film_time_ns(4));
  EXPECT_FALSE(client.read(next)) << "a result of the lost device, frame " << next.sequence();
  EXPECT_REFUSED(kUnavailable, "device lost", client.finish());
  StreamClient resumed(channel);
  ASSERT_TRUE(resumed.open("lost", {}, last.token()));
  for (size_t i = 3; i < film.size(); ++i) {
    ASSERT_TRUE(resumed.send(film[i], i, film_time_ns(i)) && resumed.read(next));
    EXPECT_EQ(next.sequence(), i);
    EXPECT_TRUE(next.pixels == whole[i].pixels);
  }
  resumed.half_close();
  EXPECT_OK(resumed.finish());
  EXPECT_TRUE(wait_until_idle(Connection(channel)));
  EXPECT_EQ(server->validation_messages(), 0u);
}

// The frames that they wait for never come.
TEST(DeviceLost, FramesThatLookAheadHoldsBackEndWithTheDeviceToo) {
  Config config = test_config();
  config.idle_timeout = absl::Minutes(1);
  const std::unique_ptr<Server> server = start_server(config);
  StreamClient client(server->in_process_channel(), true, absl::Now() + absl::Seconds(20));
  v1::StreamOpen open = open_of("held");
  open.set_lookahead(2);
  const WireFrame frame = natural(64, 48);
  ASSERT_TRUE(client.open(open) && client.send(frame, 0, 0) && client.send(frame, 1, 1));
  absl::SleepFor(absl::Milliseconds(200));  // both are metered
  server->lose_device();
  client.send(frame, 2, 2);
  const grpc::Status status = client.finish();
  EXPECT_EQ(status.error_code(), grpc::UNAVAILABLE) << status.error_message();
  EXPECT_TRUE(wait_until_idle(Connection(server->in_process_channel())));
}

TEST(DeviceLost, ASessionGoesOnByItselfOnTheNewDeviceWithTheSameBits) {
  Config config = test_config();
  config.metrics = "127.0.0.1:0";
  config.idle_timeout = absl::Minutes(1);
  const std::unique_ptr<Server> server = start_server(config);
  const auto channel = server->in_process_channel();
  const Film film = make_film(24, 320, 180);
  double expected_rebuilds = 0;
  for (const uint32_t lookahead : {0u, 2u}) {
    SessionOptions options;
    options.lookahead = lookahead;
    const SessionRun whole = run_session(Session::open({channel}, options), film);
    EXPECT_OK(whole.status);
    EXPECT_EQ(whole.images.size(), film->size());
    EXPECT_EQ(whole.stats.resumes, 0u);
    const SessionRun lossy = run_session(Session::open({channel}, options), film, [&](size_t results) {
      if (results == 5) server->lose_device();
      if (results == 14) server->lose_device(2);  // and the one that replaces it
    });
    EXPECT_OK(lossy.status);
    EXPECT_TRUE(lossy.images == whole.images);
    EXPECT_EQ(rebuilds(*server), expected_rebuilds += 3);
    // Another frame of the session may still wait for the first lost device. Its failure already replaces the
    // second one, and then the session notices one loss.
    EXPECT_GE(lossy.stats.resumes, 2u);
    EXPECT_LE(lossy.stats.resumes, 3u);
  }
  EXPECT_TRUE(wait_until_idle(Connection(channel)));
  EXPECT_EQ(server->validation_messages(), 0u);
}

TEST(DeviceLost, AGoodFrameBetweenLossesStartsTheCountAnew) {
  std::atomic<int> gone = 0;
  ASSERT_OK_AND_ASSIGN(const std::unique_ptr<Server> server,
                       Server::start(test_config(), real_clock(), alarm_timers(), [&gone] { ++gone; }));
  const Connection connection(server->in_process_channel());
  const WireFrame frame = natural(16, 16);
  for (int i = 0; i < 2; ++i) {
    server->lose_device(3);
    for (int loss = 0; loss < 3; ++loss) {
      EXPECT_TRUE(absl::IsUnavailable(connection.render({}, view(frame)).status()));
    }
    EXPECT_OK(connection.render({}, view(frame)));
  }
  EXPECT_EQ(gone, 0);
}

TEST(DeviceLost, FourLossesInARowAreSaidOnceAndHealthFollows) {
  std::atomic<int> gone = 0;
  Config config = test_config();
  config.heartbeat_interval = absl::Milliseconds(200);
  config.heartbeat_limit = absl::Seconds(1);
  ASSERT_OK_AND_ASSIGN(const std::unique_ptr<Server> server,
                       Server::start(config, real_clock(), alarm_timers(), [&gone] { ++gone; }));
  const Connection connection(server->in_process_channel());
  server->lose_device(4);
  for (const absl::Time limit = absl::Now() + absl::Seconds(30);
       connection.health().ok() && absl::Now() < limit;) {
    absl::SleepFor(absl::Milliseconds(20));
  }
  EXPECT_TRUE(absl::IsUnavailable(connection.health()));
  for (const absl::Time limit = absl::Now() + absl::Seconds(30); gone == 0 && absl::Now() < limit;) {
    absl::SleepFor(absl::Milliseconds(20));
  }
  EXPECT_TRUE(absl::IsUnavailable(connection.render({}, view(natural(16, 16))).status()));
  EXPECT_EQ(gone, 1);
}

}  // namespace
}  // namespace candela::testing
