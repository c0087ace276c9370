#include <gtest/gtest.h>

#include <filesystem>
#include <map>
#include <string>
#include <thread>

#include "server/base/process.h"
#include "server/memory_budget.h"
#include "tests/support/files.h"

namespace candela {
namespace {

constexpr char kVersion2[] = "30 24 0:26 / /sys/fs/cgroup rw,nosuid shared:4 - cgroup2 cgroup2 rw\n";
// systemd's hybrid mounts: one of version 1 per controller, and one of version 2 without controllers.
constexpr char kHybrid[] =
    "31 30 0:27 / /sys/fs/cgroup/unified rw - cgroup2 cgroup2 rw\n"
    "32 30 0:28 / /sys/fs/cgroup/cpu,cpuacct rw shared:9 - cgroup cgroup rw,cpu,cpuacct\n"
    "33 30 0:29 / /sys/fs/cgroup/memory rw shared:10 - cgroup cgroup rw,memory\n";
// docker run on a version 1 host: the mount starts at the container's group, but the group's name is the
// host's.
constexpr char kDocker[] =
    "40 30 0:28 /docker/0123 /sys/fs/cgroup/cpu,cpuacct ro - cgroup cgroup rw,cpu,cpuacct\n"
    "41 30 0:29 /docker/0123 /sys/fs/cgroup/memory ro - cgroup cgroup rw,memory\n";

struct Machine {
  const char* name;
  std::string mounts;
  std::string groups;
  std::string root;                          // of `files`
  std::map<std::string, std::string> files;  // without their last newline
  CgroupLimits limits;                       // `_from` are below root
};

const Machine kMachines[] = {
    {"NoGroup", "", "0::/\n", "", {}, {}},
    {"Version2InsideAContainer",
     kVersion2,
     "0::/\n",
     "sys/fs/cgroup/",
     {{"cpu.max", "150000 100000"}, {"memory.max", "1073741824"}, {"memory.high", "max"}},
     {1.5, "cpu.max", uint64_t{1} << 30, "memory.max"}},
    {"Version2TakesTheLeastUpToTheRoot",
     kVersion2,
     "0::/a.slice/b.slice/c.service\n",
     "sys/fs/cgroup/a.slice/",
     {{"cpu.max", "200000 100000"},
      {"memory.max", "max"},
      {"b.slice/cpu.max", "max 100000"},
      {"b.slice/memory.max", "1000000"},
      {"b.slice/c.service/cpu.max", "400000 100000"},
      {"b.slice/c.service/memory.max", "2000000"}},
     {2.0, "cpu.max", 1000000, "b.slice/memory.max"}},
    {"AThrottleOfMemoryIsALimitToo",
     kVersion2,
     "0::/\n",
     "sys/fs/cgroup/",
     {{"memory.max", "2000000"}, {"memory.high", "1000000"}},
     {{}, "", 1000000, "memory.high"}},
    {"Version2WithoutLimits",
     kVersion2,
     "0::/\n",
     "sys/fs/cgroup/",
     {{"cpu.max", "max 100000"}, {"memory.max", "max"}},
     {}},
    // Other groups' limits do not apply to this process.
    {"ANeighbourIsNotLookedAt",
     kVersion2,
     "0::/a\n",
     "sys/fs/cgroup/",
     {{"b/cpu.max", "1000 100000"}, {"b/memory.max", "1"}, {"a/b/memory.max", "1"}},
     {}},
    {"Version1BesideVersion2WithoutControllers",
     kHybrid,
     "12:cpuset:/\n4:cpu,cpuacct:/a/b\n3:memory:/a\n0::/a/b\n",
     "sys/fs/cgroup/",
     {{"cpu,cpuacct/cpu.cfs_quota_us", "-1"},
      {"cpu,cpuacct/cpu.cfs_period_us", "100000"},
      {"cpu,cpuacct/a/b/cpu.cfs_quota_us", "50000"},
      {"cpu,cpuacct/a/b/cpu.cfs_period_us", "100000"},
      {"memory/memory.limit_in_bytes", "9223372036854771712"},
      {"memory/a/memory.limit_in_bytes", "536870912"}},
     {0.5, "cpu,cpuacct/a/b/cpu.cfs_quota_us", uint64_t{512} << 20, "memory/a/memory.limit_in_bytes"}},
    {"Version1WithoutLimits",
     kHybrid,
     "4:cpu,cpuacct:/\n3:memory:/\n",
     "sys/fs/cgroup/",
     {{"cpu,cpuacct/cpu.cfs_quota_us", "-1"},
      {"cpu,cpuacct/cpu.cfs_period_us", "100000"},
      {"memory/memory.limit_in_bytes", "9223372036854771712"}},
     {}},
    {"AMountThatBeginsAtTheGroupItself",
     kDocker,
     "4:cpu,cpuacct:/docker/0123\n3:memory:/docker/0123/inner\n",
     "sys/fs/cgroup/",
     {{"cpu,cpuacct/cpu.cfs_quota_us", "300000"},
      {"cpu,cpuacct/cpu.cfs_period_us", "100000"},
      {"memory/memory.limit_in_bytes", "2000000"},
      {"memory/inner/memory.limit_in_bytes", "1000000"}},
     {3.0, "cpu,cpuacct/cpu.cfs_quota_us", 1000000, "memory/inner/memory.limit_in_bytes"}},
    // The group's name is outside the mount, as after leaving a namespace. Then only the mount counts.
    {"AGroupThatTheMountDoesNotShow",
     kVersion2,
     "0::/../other\n",
     "sys/fs/",
     {{"cgroup/memory.max", "3000000"}, {"other/memory.max", "1"}},
     {{}, "", 3000000, "cgroup/memory.max"}},
    {"AMountPointWithASpaceInIt",
     "30 24 0:26 / /my\\040groups rw - cgroup2 cgroup2 rw\n",
     "0::/\n",
     "my groups/",
     {{"memory.max", "1000000"}},
     {{}, "", 1000000, "memory.max"}},
    {"FilesThatMakeNoSenseAreNoLimit",
     std::string("nonsense\n - cgroup2 x\n") + kVersion2,
     "nonsense\n0::/\n\n",
     "sys/fs/cgroup/",
     {{"cpu.max", "-5 0"}, {"memory.max", ""}},
     {}}};

class Cgroup : public ::testing::TestWithParam<Machine> {};

TEST_P(Cgroup, LimitsAreThoseOfTheProcess) {
  const TemporaryFolder root;
  const auto write = [&](const std::string& below, const std::string& text) {
    std::filesystem::create_directories(std::filesystem::path(root.path(below)).parent_path());
    write_file(root.path(below), text);
  };
  const Machine& machine = GetParam();
  write("proc/self/mountinfo", "22 1 8:1 / / rw - ext4 /dev/a rw\n" + machine.mounts);
  write("proc/self/cgroup", machine.groups);
  for (const auto& [name, text] : machine.files) write(machine.root + name, text + "\n");
  const CgroupLimits limits = read_cgroup_limits(root.path("")), &expected = machine.limits;
  EXPECT_EQ(limits.cpus, expected.cpus);
  EXPECT_EQ(limits.memory_bytes, expected.memory_bytes);
  EXPECT_EQ(limits.cpus_from, expected.cpus ? root.path(machine.root + expected.cpus_from) : "");
  EXPECT_EQ(limits.memory_from, expected.memory_bytes ? root.path(machine.root + expected.memory_from) : "");
}

INSTANTIATE_TEST_SUITE_P(Of, Cgroup, ::testing::ValuesIn(kMachines),
                         [](const auto& machine) { return std::string(machine.param.name); });

TEST(CgroupFiles, ThatAreNotThereAreNoLimit) {
  const TemporaryFolder nothing;
  EXPECT_FALSE(read_cgroup_limits(nothing.path("")).cpus);
  EXPECT_FALSE(read_cgroup_limits(nothing.path("")).memory_bytes);
}

TEST(UsableCpus, AreTheQuotaRoundedUpWithinWhatIsThere) {
  const uint32_t visible = std::thread::hardware_concurrency();
  EXPECT_EQ(usable_cpus({}), visible);
  EXPECT_EQ(usable_cpus({.cpus = 0.1, .cpus_from = "", .memory_bytes = {}, .memory_from = ""}), 1u);
  EXPECT_EQ(usable_cpus({.cpus = visible - 0.5, .cpus_from = "", .memory_bytes = {}, .memory_from = ""}),
            visible);
  EXPECT_EQ(usable_cpus({.cpus = 1e6, .cpus_from = "", .memory_bytes = {}, .memory_from = ""}), visible);
}

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
