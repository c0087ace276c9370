// The texture pool: reuse, budget, counters.
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <limits>
#include <memory>
#include <utility>

#include "server/render/environment/environment_baker.h"
#include "server/vulkan/functions.h"
#include "server/vulkan/pipeline.h"
#include "shaders/bloom_down.spv.h"
#include "tests/support/clock.h"
#include "tests/support/device_fixture.h"
#include "tests/support/status.h"

namespace candela::testing {
namespace {

int allocations_that_fail = 0;
PFN_vkAllocateMemory allocate_memory = nullptr;  // Vulkan's

VkResult fail_or_allocate(VkDevice device, const VkMemoryAllocateInfo* info,
                          const VkAllocationCallbacks* callbacks, VkDeviceMemory* memory) {
  if (allocations_that_fail > 0) {
    --allocations_that_fail;
    return VK_ERROR_OUT_OF_DEVICE_MEMORY;
  }
  return allocate_memory(device, info, callbacks, memory);
}

// The fixture's device has the function for as long as this is here.
class FailingMemory {
 public:
  FailingMemory() { allocate_memory = std::exchange(vkAllocateMemory, fail_or_allocate); }
  ~FailingMemory() { vkAllocateMemory = allocate_memory; }
};

using Pool = DeviceTest;

constexpr TextureKey kKey = {100, 50, 16, MemoryUse::kDevice};
constexpr uint64_t kBytes = 100 * 50 * 16;

TEST_F(Pool, GivesTheSameTextureAgain) {
  TexturePool local(device(), 10 * kBytes, real_clock());
  VkBuffer first = VK_NULL_HANDLE;
  {
    ASSERT_OK_AND_ASSIGN(auto lease, local.take(kKey));
    first = lease.buffer().handle();
    EXPECT_EQ(local.counters().bytes_in_use, kBytes);
  }
  EXPECT_EQ(local.counters().bytes_in_use, 0u);
  EXPECT_EQ(local.counters().bytes_idle, kBytes);
  ASSERT_OK_AND_ASSIGN(auto again, local.take(kKey));
  EXPECT_EQ(again.buffer().handle(), first);
  EXPECT_EQ(local.counters().hits, 1u);
  EXPECT_EQ(local.counters().misses, 1u);
}

TEST_F(Pool, RefusesWhatTheBudgetDoesNotHold) {
  TexturePool local(device(), 2 * kBytes, real_clock());
  auto a = local.take(kKey);
  auto b = local.take(kKey);
  ASSERT_TRUE(a.ok() && b.ok());
  auto c = local.take(kKey);
  EXPECT_EQ(c.status().code(), absl::StatusCode::kUnavailable);
  EXPECT_EQ(local.counters().bytes_in_use, 2 * kBytes);
  a = TexturePool::Lease();
  EXPECT_OK(local.take(kKey));
}

TEST_F(Pool, GivesUpIdleTexturesToMakeRoom) {
  TexturePool local(device(), 2 * kBytes, real_clock());
  for (uint32_t width = 51; width <= 100; ++width) {
    ASSERT_OK(local.take({width, 50, 16, MemoryUse::kDevice})) << width;
    EXPECT_LE(local.counters().bytes_idle, 2 * kBytes);
  }
  EXPECT_LE(local.counters().bytes_peak, 2 * kBytes);
}

TEST_F(Pool, GivesUpWhatNobodyTookForLong) {
  constexpr std::chrono::seconds kKeep{30};
  constexpr TextureKey kOther = {10, 10, 16, MemoryUse::kDevice};
  VirtualClock clock;
  TexturePool local(device(), 10 * kBytes, clock, kKeep);
  ASSERT_OK(local.take(kKey));
  clock.advance(absl::FromChrono(kKeep));
  ASSERT_OK(local.take(kOther));
  EXPECT_EQ(local.counters().bytes_idle, kBytes + kOther.bytes()) << "too soon";
  clock.advance(absl::Nanoseconds(1));
  ASSERT_OK(local.take(kOther));
  EXPECT_EQ(local.counters().bytes_idle, kOther.bytes());
  EXPECT_EQ(local.counters().hits, 1u) << "what is in use again is not what nobody took";
}

TEST_F(Pool, AReservationIsInUseUntilItIsGivenBackAndNeverIdle) {
  TexturePool local(device(), 2 * kBytes, real_clock());
  ASSERT_OK(local.take(kKey));  // idle now
  {
    ASSERT_OK_AND_ASSIGN(const auto reservation, local.reserve(2 * kBytes, "the bake"));
    EXPECT_EQ(local.counters().bytes_in_use, 2 * kBytes);
    EXPECT_EQ(local.counters().bytes_idle, 0u);
    EXPECT_EQ(local.take(kKey).status().code(), absl::StatusCode::kUnavailable);
    const absl::Status refused = local.reserve(1, "the bake").status();
    EXPECT_EQ(refused.code(), absl::StatusCode::kUnavailable);
    EXPECT_EQ(refused.message().find("the bake needs 1 bytes"), 0u) << refused;
  }
  EXPECT_EQ(local.counters().bytes_in_use, 0u);
  EXPECT_EQ(local.counters().bytes_idle, 0u);
  EXPECT_OK(local.take(kKey));
}

TEST_F(Pool, GivesUpTheOldestFirst) {
  const auto key = [](uint32_t width) { return TextureKey{width, 50, 16, MemoryUse::kDevice}; };
  TexturePool local(device(), 3 * 100 * 50 * 16, real_clock());
  for (uint32_t width : {98u, 99u, 100u}) ASSERT_OK(local.take(key(width)));
  ASSERT_OK(local.take(key(97)));  // 98 has to go
  const uint64_t misses = local.counters().misses;
  EXPECT_OK(local.take(key(100)));
  EXPECT_OK(local.take(key(99)));
  EXPECT_EQ(local.counters().misses, misses);
}

TEST_F(Pool, ASecondFrameTakesNothingNew) {
  const WireFrame frame = natural(123, 77);
  ASSERT_OK(render(frame, {}));
  const PoolCounters before = pool().counters();
  ASSERT_OK(render(frame, {}));
  const PoolCounters after = pool().counters();
  EXPECT_EQ(after.misses, before.misses);
  EXPECT_GT(after.hits, before.hits);
  EXPECT_EQ(after.bytes_in_use, 0u);
}

TEST_F(Pool, AFinishedFrameHoldsItsImageOnly) {
  ASSERT_OK_AND_ASSIGN(auto rendered, render(natural(200, 100), {}));
  const std::vector<std::byte> before = image(rendered.memory);
  rendered.memory.keep_output_only();
  EXPECT_EQ(pool().counters().bytes_in_use, 200u * 100u * 4u);
  // It is not affected if another frame uses the textures that were given back.
  ASSERT_OK(render(flat(200, 100, {1, 2, 3, 1}), {}));
  EXPECT_EQ(image(rendered.memory), before);
}

// Says how many bytes are counted.
class Counted final : public MemoryClaim {
 public:
  explicit Counted(uint64_t* bytes) : bytes_(bytes) {}
  ~Counted() override { *bytes_ = 0; }
  void shrink(uint64_t bytes) override { *bytes_ = bytes; }

 private:
  uint64_t* const bytes_;
};

TEST_F(Pool, AFileTakesThePlaceOfItsImage) {
  constexpr uint64_t kImage = 200u * 100u * 4u;
  for (const uint64_t file : {uint64_t{1000}, 2 * kImage}) {
    ASSERT_OK_AND_ASSIGN(auto rendered, render(natural(200, 100), {}));
    uint64_t counted = 1;
    rendered.memory.account(std::make_unique<Counted>(&counted));
    rendered.memory.keep_output_only();
    EXPECT_EQ(counted, kImage);
    rendered.memory.replace_output(file);
    EXPECT_EQ(pool().counters().bytes_in_use, 0u);
    EXPECT_EQ(counted, std::min(file, kImage));
    rendered.memory = {};
    EXPECT_EQ(counted, 0u);
  }
}

TEST_F(Pool, ADeviceWithLessMemoryThanTheBudgetGetsThatOfIdleTextures) {
  TexturePool local(device(), 100 * kBytes, real_clock());
  const auto key = [](uint32_t width) { return TextureKey{width, 50, 16, MemoryUse::kDevice}; };
  for (uint32_t width : {98u, 99u, 100u}) ASSERT_OK(local.take(key(width)));
  const FailingMemory failing;
  allocations_that_fail = 2;
  ASSERT_OK_AND_ASSIGN(const auto lease, local.take(key(97)));
  EXPECT_EQ(allocations_that_fail, 0);
  EXPECT_EQ(local.counters().bytes_idle, kBytes);  // two had to go, the oldest first
  EXPECT_OK(local.take(key(100)));
  EXPECT_EQ(local.counters().hits, 1u);
}

TEST_F(Pool, AFrameForWhichTheDeviceHasNoMemoryNowCanBeTriedAgain) {
  TexturePool local(device(), uint64_t{1} << 30, real_clock());
  ASSERT_OK_AND_ASSIGN(auto renderer, Renderer::create(device(), local));
  const FrameDesc desc = {100, 100, v1::PIXEL_FORMAT_RGBA16F};
  const FailingMemory failing;
  allocations_that_fail = std::numeric_limits<int>::max();
  const absl::Status alone = renderer->allocate(desc, {}).status();
  allocations_that_fail = 0;
  EXPECT_REFUSED(kResourceExhausted, "", alone);
  ASSERT_OK_AND_ASSIGN(const auto first, renderer->allocate(desc, {}));
  allocations_that_fail = std::numeric_limits<int>::max();
  const absl::Status beside = renderer->allocate(desc, {}).status();
  const absl::Status panorama = PanoramaUpload::take(local, device().summary(), desc).status();
  allocations_that_fail = 0;
  EXPECT_REFUSED(kUnavailable, "", beside);
  EXPECT_REFUSED(kUnavailable, "", panorama);
  EXPECT_TRUE(says(beside.message(), "texture of"));
}

TEST_F(Pool, AFrameThatDoesNotFitTakesNothing) {
  TexturePool small(device(), 1 << 20, real_clock());
  ASSERT_OK_AND_ASSIGN(auto renderer, Renderer::create(device(), small));
  ASSERT_OK(renderer->allocate({100, 100, v1::PIXEL_FORMAT_RGBA16F}, {}));
  const PoolCounters before = small.counters();
  const auto memory = renderer->allocate({1920, 1080, v1::PIXEL_FORMAT_RGBA16F}, {});
  EXPECT_REFUSED(kResourceExhausted, "the memory budget is 1048576", memory);
  const PoolCounters after = small.counters();
  EXPECT_EQ(after.bytes_in_use, 0u);
  EXPECT_EQ(after.bytes_idle, before.bytes_idle) << "what could never fit made others lose their textures";
  EXPECT_EQ(after.misses, before.misses);
}

TEST_F(Pool, PipelinesAreBoundedToo) {
  ASSERT_OK_AND_ASSIGN(auto cache, PipelineCache::create(device()));
  for (uint32_t n = 0; n < 3; ++n) ASSERT_OK(cache.get(k_bloom_down_spirv, {n}));
  ASSERT_OK(cache.get(k_bloom_down_spirv, {0}));
  EXPECT_EQ(cache.size(), 3u);
  cache.trim(3);
  EXPECT_EQ(cache.size(), 3u);
  cache.trim(2);
  EXPECT_EQ(cache.size(), 0u);
}

}  // namespace
}  // namespace candela::testing
