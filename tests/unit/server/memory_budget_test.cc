#include "server/memory_budget.h"

#include <gtest/gtest.h>

namespace candela {
namespace {

constexpr uint64_t kMiB = uint64_t{1} << 20;
constexpr uint64_t kGiB = uint64_t{1} << 30;

MemoryBudget within(uint64_t limit, uint64_t asked = 0) {
  CgroupLimits limits;
  limits.memory_bytes = limit;
  limits.memory_from = "/sys/fs/cgroup/memory.max";
  return choose_memory_budget(asked, limits);
}

TEST(MemoryBudget, WithoutALimitIsTheDefault) {
  EXPECT_EQ(choose_memory_budget(0, {}).bytes, 2 * kGiB);
  EXPECT_GE(choose_memory_budget(0, {}).most_sessions, 4096u);
  EXPECT_EQ(within(64 * kGiB).bytes, 2 * kGiB);
}

TEST(MemoryBudget, FollowsASmallLimitAndSaysWhich) {
  EXPECT_EQ(within(kGiB).bytes, 384 * kMiB);
  EXPECT_EQ(within(kGiB).from, "3/8 of the 1GiB in /sys/fs/cgroup/memory.max");
  EXPECT_EQ(within(kGiB).most_sessions, 26u);
  EXPECT_FALSE(within(kGiB).beyond_the_limit);
  EXPECT_EQ(within(1000).bytes, kMiB);
  EXPECT_EQ(within(1000).most_sessions, 1u);
}

TEST(MemoryBudget, WhatWasAskedForIsTakenAndWarnedOf) {
  EXPECT_EQ(within(kGiB, 512 * kMiB).bytes, 512 * kMiB);
  EXPECT_EQ(within(kGiB, 512 * kMiB).most_sessions, 16u);
  EXPECT_FALSE(within(kGiB, kGiB).beyond_the_limit);
  EXPECT_TRUE(within(kGiB, kGiB + 1).beyond_the_limit);
  EXPECT_EQ(choose_memory_budget(4 * kGiB, {}).bytes, 4 * kGiB);
}

// Two GiB of a container are 768 MiB of textures, 320 of the process and 12 for each of 80 sessions.
TEST(MemoryBudget, WhatGrpcMayHoldIsWhatSessionsAndCallsWereLeft) {
  EXPECT_EQ(within(2 * kGiB).most_sessions, 80u);
  EXPECT_EQ(grpc_quota_bytes(80, 80), (80 * 12 + 64) * kMiB);
  EXPECT_EQ(grpc_quota_bytes(1, 80), (80 * 12 + 64) * kMiB);
}

}  // namespace
}  // namespace candela
