#include "tests/support/device_fixture.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <cstring>
#include <map>
#include <utility>

#include "server/vulkan/functions.h"
#include "tests/support/status.h"

namespace candela::testing {

void keep_driver_loaded() {
  static VkInstance instance = VK_NULL_HANDLE;
  if (instance != VK_NULL_HANDLE) return;
  ASSERT_EQ(load_vulkan(), absl::OkStatus());
  VkInstanceCreateInfo info{};
  info.sType = VK_STRUCTURE_TYPE_INSTANCE_CREATE_INFO;
  EXPECT_EQ(vkCreateInstance(&info, nullptr, &instance), VK_SUCCESS);
}

ExecutorKind executor_of_environment() {
  const char* word = std::getenv("CANDELA_TEST_EXECUTOR");
  return word == nullptr ? ExecutorKind::kAuto : parse_executor(word).value();
}

namespace {

struct Shared {
  std::unique_ptr<Device> device;
  std::unique_ptr<TexturePool> pool;
  std::unique_ptr<Renderer> renderer;
  std::map<std::pair<ExecutorKind, uint32_t>, std::unique_ptr<Renderer>> others;
};

std::unique_ptr<Shared> g_shared;
[[maybe_unused]] ::testing::Environment* const close_shared =
    ::testing::AddGlobalTestEnvironment(new CloseAfterTests([] { g_shared.reset(); }));

Shared& shared() {
  if (!g_shared) g_shared = std::make_unique<Shared>();
  return *g_shared;
}

}  // namespace

void DeviceTest::SetUpTestSuite() {
  if (shared().renderer) return;
  keep_driver_loaded();
  auto device = Device::create({});
  ASSERT_OK(device);
  shared().device = *std::move(device);
  shared().pool = std::make_unique<TexturePool>(*shared().device, uint64_t{4} << 30, real_clock());
  auto renderer = Renderer::create(*shared().device, *shared().pool, executor_of_environment());
  ASSERT_OK(renderer);
  shared().renderer = *std::move(renderer);
}

void DeviceTest::SetUp() { messages_before_ = device().validation_messages(); }

void DeviceTest::TearDown() {
  EXPECT_EQ(device().validation_messages(), messages_before_) << "the validation layers had something to say";
}

Device& DeviceTest::device() { return *shared().device; }
TexturePool& DeviceTest::pool() { return *shared().pool; }
Renderer& DeviceTest::renderer() { return *shared().renderer; }

Renderer& DeviceTest::renderer_with(ExecutorKind executor, uint32_t threads) {
  std::unique_ptr<Renderer>& other = shared().others[{executor, threads}];
  if (!other) other = Renderer::create(device(), pool(), executor, threads).value();
  return *other;
}

absl::StatusOr<DeviceTest::Rendered> DeviceTest::render(const WireFrame& frame, const v1::Settings& settings,
                                                        const FrameMoment& moment, Verify verify) {
  return render_on(renderer(), frame, settings, moment, verify);
}

std::vector<std::byte> DeviceTest::image(const FrameMemory& memory) {
  std::vector<std::byte> bytes;
  for (uint32_t y = 0; y < memory.image().height; ++y) {
    const auto row = memory.output_row(y);
    bytes.insert(bytes.end(), row.begin(), row.end());
  }
  return bytes;
}

absl::StatusOr<DeviceTest::Rendered> DeviceTest::render_on(Renderer& renderer, const WireFrame& frame,
                                                           const v1::Settings& settings,
                                                           const FrameMoment& moment, Verify verify) {
  const absl::StatusOr<Settings> checked = Settings::from(settings);
  if (!checked.ok()) return checked.status();
  absl::StatusOr<FrameMemory> memory = renderer.allocate(frame.desc, *checked, verify);
  if (!memory.ok()) return memory.status();
  for (uint32_t y = 0; y < frame.desc.height; ++y) {
    std::memcpy(memory->input_row(y).data(), frame.pixels.data() + y * frame.desc.row_bytes(),
                frame.desc.row_bytes());
  }
  absl::StatusOr<FrameReport> report = renderer.render(*memory, *checked, moment);
  if (!report.ok()) return report.status();
  return Rendered{*std::move(memory), *std::move(report)};
}

}  // namespace candela::testing
