// Devices: one that is lost, the host without Vulkan, and one that renders other bits.
#include "server/vulkan/device.h"

#include <gtest/gtest.h>
#include <hwy/targets.h>

#include <atomic>
#include <set>

#include "absl/cleanup/cleanup.h"
#include "absl/time/clock.h"
#include "server/device_keeper.h"
#include "tests/service/clients.h"
#include "tests/service/environment_fixture.h"
#include "tests/service/service_fixture.h"
#include "tests/support/clock.h"
#include "tests/support/device_fixture.h"
#include "tests/support/files.h"
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

// A server without a Vulkan device.

class HostDevice : public ::testing::Test {
 protected:
  void SetUp() override {
    Config config = test_config();
    config.device = kHostDevice;
    absl::StatusOr<std::unique_ptr<Server>> server = Server::start(config, real_clock(), alarm_timers());
    if (absl::IsFailedPrecondition(server.status())) GTEST_SKIP() << server.status();
    ASSERT_OK(server);
    server_ = *std::move(server);
  }
  Connection connection() const { return Connection(server_->in_process_channel()); }
  v1::GetServerInfoResponse info() const { return connection().server_info().value(); }

  std::unique_ptr<Server> server_;
};

std::string bytes_of(const RenderResult& result) {
  return std::string(reinterpret_cast<const char*>(result.data.get()), result.bytes);
}

TEST_F(HostDevice, RendersTheBitsOfTheHostInTheMemoryOfAVulkanDevice) {
  Config config = test_config();
  config.executor = ExecutorKind::kHost;
  absl::StatusOr<std::unique_ptr<Server>> other = Server::start(config, real_clock(), alarm_timers());
  if (absl::IsFailedPrecondition(other.status())) GTEST_SKIP() << other.status();
  ASSERT_OK(other);
  const Connection vulkan((*other)->in_process_channel());
  EXPECT_EQ(info().device().bits(), vulkan.server_info()->device().bits());
  for (const char* const tier : {"draft", "standard", "reference"}) {
    v1::Settings settings;
    settings.set_tier(tier);
    settings.mutable_bloom()->set_intensity(0.5f);
    // The second frame takes the textures of the first.
    for (const WireFrame& frame : {natural(641, 359), natural(640, 360), natural(1, 1)}) {
      FrameView one = view(frame);
      one.verify = true;
      ASSERT_OK_AND_ASSIGN(const RenderResult here, connection().render(settings, one));
      ASSERT_OK_AND_ASSIGN(const RenderResult there, vulkan.render(settings, one));
      EXPECT_EQ(bytes_of(here), bytes_of(there)) << tier;
      EXPECT_EQ(here.header.exposure(), there.header.exposure());
      EXPECT_EQ(here.header.device(), kHostDevice);
    }
  }
}

TEST_F(HostDevice, SaysInItsInformationThatItHasNoVulkanAndNoEnvironments) {
  const v1::DeviceInfo device = info().device();
  EXPECT_EQ(device.name(), kHostDevice);
  EXPECT_EQ(device.type(), "CPU");
  EXPECT_EQ(device.driver(), "");
  EXPECT_EQ(device.api_version(), "");
  EXPECT_TRUE(device.unified_memory());
  EXPECT_EQ(device.passes(), "host");
  EXPECT_EQ(info().limits().environment_budget_bytes(), 0u);
}

TEST_F(HostDevice, RefusesEveryCallForAnEnvironmentAndSaysWhatToDo) {
  constexpr char kWords[] = "use another server, or start this one without --device host";
  const auto panorama = uniform(0.5f);
  const std::string id = environment_id(*panorama);
  EXPECT_REFUSED(kFailedPrecondition, kWords, connection().put_environment(*panorama));
  EXPECT_REFUSED(kFailedPrecondition, kWords, connection().get_environment(id));
  EXPECT_REFUSED(kFailedPrecondition, kWords, connection().drop_environment(id));
  EXPECT_REFUSED(kFailedPrecondition, kWords, connection().render({}, frame_of(view_of(id))));
  EXPECT_REFUSED(kFailedPrecondition, kWords, connection().meter({}, frame_of(view_of(id))));
  v1::BakeEnvironmentRequest bake;
  bake.set_id(id);
  bake.set_format(v1::PIXEL_FORMAT_RGBA16F);
  EXPECT_REFUSED(kFailedPrecondition, kWords, connection().bake_environment(bake));
  EXPECT_OK(connection().render({}, view(natural(64, 64)))) << "a refusal hurts others";
}

TEST_F(HostDevice, GoesOnAfterALossAndWithoutMemory) {
  const WireFrame frame = natural(320, 240);
  ASSERT_OK_AND_ASSIGN(const RenderResult before, connection().render({}, view(frame)));
  server_->lose_device();
  EXPECT_REFUSED(kUnavailable, "device lost: host", connection().render({}, view(frame)));
  ASSERT_OK_AND_ASSIGN(const RenderResult after, connection().render({}, view(frame)));
  EXPECT_EQ(bytes_of(before), bytes_of(after));
  EXPECT_TRUE(wait_until_idle(connection()));
  server_->refuse_device_memory();
  EXPECT_REFUSED(kResourceExhausted, "memory", connection().render({}, view(natural(500, 500))));
}

absl::StatusOr<std::shared_ptr<RenderDevice>> open_device(const DeviceOptions& options,
                                                          ExecutorKind executor) {
  return open_render_device(options, uint64_t{64} << 20, real_clock(), executor);
}

TEST_F(HostDevice, IsTakenWithoutAGpuOnly) {
  for (const ExecutorKind executor : {ExecutorKind::kAuto, ExecutorKind::kHost}) {
    ASSERT_OK_AND_ASSIGN(const auto opened,
                         open_device({.selector = "", .host_without_gpu = true}, executor));
    if (has_gpu() && executor == ExecutorKind::kAuto) continue;  // it may have no driver
    EXPECT_TRUE(opened->device->is_host());
    EXPECT_EQ(opened->renderer->executor_kind(), ExecutorKind::kHost);
  }
  EXPECT_REFUSED(kNotFound, "no-such-device",
                 open_device({.selector = "no-such-device", .host_without_gpu = true}, ExecutorKind::kAuto));
}

TEST_F(HostDevice, IsNoneForAProcessorWithoutTheKernels) {
  hwy::SetSupportedTargetsForTest(HWY_EMU128);
  const absl::Cleanup restore = [] { hwy::SetSupportedTargetsForTest(0); };
  constexpr char kWhy[] = "this processor has no vectors with fused multiply-add";
  EXPECT_REFUSED(kFailedPrecondition, kWhy, open_device({.selector = kHostDevice}, ExecutorKind::kAuto));
  const absl::StatusOr<std::shared_ptr<RenderDevice>> opened =
      open_device({.selector = "", .host_without_gpu = true}, ExecutorKind::kAuto);
  if (absl::IsFailedPrecondition(opened.status())) GTEST_SKIP() << opened.status();
  ASSERT_OK(opened);
  EXPECT_FALSE((*opened)->device->is_host());
  EXPECT_EQ((*opened)->renderer->executor_words(), absl::StrCat("on the device: ", kWhy));
}

TEST(Gpu, IsThereIfTheKernelShowsANodeOfOne) {
  const TemporaryFolder devices;
  EXPECT_FALSE(has_gpu(devices.path("")));
  std::filesystem::create_directory(devices.path("dri"));
  write_file(devices.path("dri/card0"), "");  // a display
  EXPECT_FALSE(has_gpu(devices.path("")));
  for (const char* const node : {"dri/renderD129", "nvidiactl", "dxg"}) {
    write_file(devices.path(node), "");
    EXPECT_TRUE(has_gpu(devices.path(""))) << node;
    std::filesystem::remove(devices.path(node));
  }
}

// What a server says of its bits, and a lost device that comes back with others.

absl::StatusOr<std::shared_ptr<RenderDevice>> open_device() {
  return open_render_device(DeviceOptions{}, uint64_t{64} << 20, real_clock(), executor_of_environment());
}

// A keeper whose device is opened again as `change` makes it.
struct Kept {
  explicit Kept(std::function<void(RenderDevice&)> change)
      : metrics("0", "device", "driver", "passes"),
        keeper(open_device().value(),
               [change = std::move(change)] {
                 absl::StatusOr<std::shared_ptr<RenderDevice>> opened = open_device();
                 if (opened.ok()) change(**opened);
                 return opened;
               },
               metrics, {.on_replaced = [this] { ++replaced; }, .on_gone = [this] { ++gone; }}) {}

  // The device is lost, and a frame fails because of it.
  void lose() {
    keeper.lose(1);
    keeper.job_ended(nullptr, absl::UnavailableError("device lost"));
  }

  Metrics metrics;
  int replaced = 0, gone = 0;
  DeviceKeeper keeper;
};

TEST(OtherBits, ADeviceThatComesBackWithItsBitsGoesOn) {
  Kept kept([](RenderDevice&) {});
  const std::string bits = kept.keeper.current()->bits;
  EXPECT_EQ(bits.size(), 16u);
  kept.lose();
  EXPECT_EQ(kept.replaced, 1);
  EXPECT_FALSE(kept.keeper.gone());
  EXPECT_EQ(kept.keeper.current()->bits, bits);
}

TEST(OtherBits, ADeviceThatComesBackWithOthersIsGivenUp) {
  Kept kept([](RenderDevice& device) { device.bits[0] = device.bits[0] == '0' ? '1' : '0'; });
  const std::shared_ptr<RenderDevice> first = kept.keeper.current();
  for (int i = 0; i < kMaxRebuilds; ++i) {
    EXPECT_FALSE(kept.keeper.gone());
    kept.lose();
  }
  kept.lose();
  EXPECT_TRUE(kept.keeper.gone());
  EXPECT_EQ(kept.gone, 1);
  EXPECT_EQ(kept.replaced, 0);
  EXPECT_EQ(kept.keeper.current(), first);
}

TEST(OtherBits, ServersOfOneKindSayTheSameInInfoAndSession) {
  std::set<std::string> said;
  for (int i = 0; i < 2; ++i) {
    const std::unique_ptr<Server> server = start_server(test_config());
    const auto channel = server->in_process_channel();
    said.insert(Connection(channel).server_info().value().device().bits());
    StreamClient client(channel);
    v1::StreamOpen open;
    open.set_session("shot");
    ASSERT_TRUE(client.open(open));
    client.half_close();
    EXPECT_TRUE(client.read_all().empty());
    said.insert(client.opened().bits());
  }
  EXPECT_EQ(said.size(), 1u);
  EXPECT_EQ(said.begin()->size(), 16u);
}

}  // namespace
}  // namespace candela::testing
