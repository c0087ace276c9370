// A server without a Vulkan device.
#include <gtest/gtest.h>
#include <hwy/targets.h>

#include "absl/cleanup/cleanup.h"
#include "server/device_keeper.h"
#include "server/vulkan/device.h"
#include "tests/service/environments/environment_fixture.h"
#include "tests/service/service_fixture.h"
#include "tests/service/sessions/session_run.h"
#include "tests/support/clock/real_clock.h"
#include "tests/support/files.h"
#include "tests/support/status.h"

namespace candela::testing {
namespace {

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

absl::StatusOr<std::shared_ptr<RenderDevice>> open(const DeviceOptions& options, ExecutorKind executor) {
  return open_render_device(options, uint64_t{64} << 20, real_clock(), executor);
}

TEST_F(HostDevice, IsTakenWithoutAGpuOnly) {
  for (const ExecutorKind executor : {ExecutorKind::kAuto, ExecutorKind::kHost}) {
    ASSERT_OK_AND_ASSIGN(const auto opened, open({.selector = "", .host_without_gpu = true}, executor));
    if (has_gpu() && executor == ExecutorKind::kAuto) continue;  // it may have no driver
    EXPECT_TRUE(opened->device->is_host());
    EXPECT_EQ(opened->renderer->executor_kind(), ExecutorKind::kHost);
  }
  EXPECT_REFUSED(kNotFound, "no-such-device",
                 open({.selector = "no-such-device", .host_without_gpu = true}, ExecutorKind::kAuto));
}

TEST_F(HostDevice, IsNoneForAProcessorWithoutTheKernels) {
  hwy::SetSupportedTargetsForTest(HWY_EMU128);
  const absl::Cleanup restore = [] { hwy::SetSupportedTargetsForTest(0); };
  constexpr char kWhy[] = "this processor has no vectors with fused multiply-add";
  EXPECT_REFUSED(kFailedPrecondition, kWhy, open({.selector = kHostDevice}, ExecutorKind::kAuto));
  const absl::StatusOr<std::shared_ptr<RenderDevice>> opened =
      open({.selector = "", .host_without_gpu = true}, ExecutorKind::kAuto);
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

}  // namespace
}  // namespace candela::testing
