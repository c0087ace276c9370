// The texture pool: reuse, budget, counters.
#include <gtest/gtest.h>

#include "tests/support/device_fixture.h"

namespace candela::testing {
namespace {

using Pool = DeviceTest;

constexpr TextureKey kKey = {100, 50, 16, MemoryUse::kDevice};
constexpr uint64_t kBytes = 100 * 50 * 16;

TEST_F(Pool, GivesTheSameTextureAgain) {
  TexturePool local(device(), 10 * kBytes);
  VkBuffer first = VK_NULL_HANDLE;
  {
    auto lease = local.take(kKey);
    ASSERT_TRUE(lease.ok()) << lease.status();
    first = lease->buffer().handle();
    EXPECT_EQ(local.counters().bytes_in_use, kBytes);
  }
  EXPECT_EQ(local.counters().bytes_in_use, 0u);
  EXPECT_EQ(local.counters().bytes_idle, kBytes);
  auto again = local.take(kKey);
  ASSERT_TRUE(again.ok());
  EXPECT_EQ(again->buffer().handle(), first);
  EXPECT_EQ(local.counters().hits, 1u);
  EXPECT_EQ(local.counters().misses, 1u);
}

TEST_F(Pool, RefusesWhatTheBudgetDoesNotHold) {
  TexturePool local(device(), 2 * kBytes);
  auto a = local.take(kKey);
  auto b = local.take(kKey);
  ASSERT_TRUE(a.ok() && b.ok());
  auto c = local.take(kKey);
  EXPECT_EQ(c.status().code(), absl::StatusCode::kResourceExhausted);
  EXPECT_EQ(local.counters().bytes_in_use, 2 * kBytes);
  *a = TexturePool::Lease();
  EXPECT_TRUE(local.take(kKey).ok());
}

TEST_F(Pool, GivesUpIdleTexturesToMakeRoom) {
  TexturePool local(device(), 2 * kBytes);
  for (uint32_t width = 51; width <= 100; ++width) {
    ASSERT_TRUE(local.take({width, 50, 16, MemoryUse::kDevice}).ok()) << width;
    EXPECT_LE(local.counters().bytes_idle, 2 * kBytes);
  }
  EXPECT_LE(local.counters().bytes_peak, 2 * kBytes);
}

TEST_F(Pool, ASecondFrameTakesNothingNew) {
  const WireFrame frame = natural(123, 77);
  ASSERT_TRUE(render(frame, {}).ok());
  const PoolCounters before = pool().counters();
  ASSERT_TRUE(render(frame, {}).ok());
  const PoolCounters after = pool().counters();
  EXPECT_EQ(after.misses, before.misses);
  EXPECT_GT(after.hits, before.hits);
  EXPECT_EQ(after.bytes_in_use, 0u);
}

TEST_F(Pool, AFrameThatDoesNotFitTakesNothing) {
  TexturePool small(device(), 1 << 20);
  auto renderer = Renderer::create(device(), small);
  ASSERT_TRUE(renderer.ok());
  const auto memory = (*renderer)->allocate({1920, 1080, PixelFormat::kRgba16f}, {});
  EXPECT_EQ(memory.status().code(), absl::StatusCode::kResourceExhausted);
  EXPECT_EQ(small.counters().bytes_in_use, 0u);
}

}  // namespace
}  // namespace candela::testing
