#include "server/base/process/cgroup.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <string>
#include <thread>

#include "tests/support/files.h"

namespace candela {
namespace {

constexpr char kVersion2[] = "30 24 0:26 / /sys/fs/cgroup rw,nosuid shared:4 - cgroup2 cgroup2 rw\n";
// systemd's hybrid mounts: one of version 1 per controller, and one of version 2 without controllers.
constexpr char kHybrid[] =
    "31 30 0:27 / /sys/fs/cgroup/unified rw - cgroup2 cgroup2 rw\n"
    "32 30 0:28 / /sys/fs/cgroup/cpu,cpuacct rw shared:9 - cgroup cgroup rw,cpu,cpuacct\n"
    "33 30 0:29 / /sys/fs/cgroup/memory rw shared:10 - cgroup cgroup rw,memory\n";

class Cgroup : public ::testing::Test {
 protected:
  void write(const std::string& below, const std::string& text) {
    std::filesystem::create_directories(std::filesystem::path(path(below)).parent_path());
    write_file(path(below), text);
  }
  void mounts(const std::string& text) {
    write("proc/self/mountinfo", "22 1 8:1 / / rw - ext4 /dev/a rw\n" + text);
  }
  CgroupLimits limits() const { return read_cgroup_limits(root_.path("")); }
  std::string path(const std::string& below) const { return root_.path(below); }

  const TemporaryFolder root_;
};

TEST_F(Cgroup, NoGroupIsNoLimit) {
  EXPECT_FALSE(limits().cpus);
  EXPECT_FALSE(limits().memory_bytes);
  mounts("");
  write("proc/self/cgroup", "0::/\n");
  EXPECT_FALSE(limits().cpus);
  EXPECT_FALSE(limits().memory_bytes);
}

TEST_F(Cgroup, Version2InsideAContainer) {
  mounts(kVersion2);
  write("proc/self/cgroup", "0::/\n");
  write("sys/fs/cgroup/cpu.max", "150000 100000\n");
  write("sys/fs/cgroup/memory.max", "1073741824\n");
  write("sys/fs/cgroup/memory.high", "max\n");
  EXPECT_EQ(limits().cpus, 1.5);
  EXPECT_EQ(limits().cpus_from, path("sys/fs/cgroup/cpu.max"));
  EXPECT_EQ(limits().memory_bytes, uint64_t{1} << 30);
  EXPECT_EQ(limits().memory_from, path("sys/fs/cgroup/memory.max"));
}

TEST_F(Cgroup, Version2TakesTheLeastUpToTheRoot) {
  mounts(kVersion2);
  write("proc/self/cgroup", "0::/a.slice/b.slice/c.service\n");
  write("sys/fs/cgroup/a.slice/cpu.max", "200000 100000\n");
  write("sys/fs/cgroup/a.slice/memory.max", "max\n");
  write("sys/fs/cgroup/a.slice/b.slice/cpu.max", "max 100000\n");
  write("sys/fs/cgroup/a.slice/b.slice/memory.max", "1000000\n");
  write("sys/fs/cgroup/a.slice/b.slice/c.service/cpu.max", "400000 100000\n");
  write("sys/fs/cgroup/a.slice/b.slice/c.service/memory.max", "2000000\n");
  EXPECT_EQ(limits().cpus, 2.0);
  EXPECT_EQ(limits().cpus_from, path("sys/fs/cgroup/a.slice/cpu.max"));
  EXPECT_EQ(limits().memory_bytes, 1000000u);
  EXPECT_EQ(limits().memory_from, path("sys/fs/cgroup/a.slice/b.slice/memory.max"));
}

TEST_F(Cgroup, AThrottleOfMemoryIsALimitToo) {
  mounts(kVersion2);
  write("proc/self/cgroup", "0::/\n");
  write("sys/fs/cgroup/memory.max", "2000000\n");
  write("sys/fs/cgroup/memory.high", "1000000\n");
  EXPECT_EQ(limits().memory_bytes, 1000000u);
}

TEST_F(Cgroup, Version2WithoutLimits) {
  mounts(kVersion2);
  write("proc/self/cgroup", "0::/\n");
  write("sys/fs/cgroup/cpu.max", "max 100000\n");
  write("sys/fs/cgroup/memory.max", "max\n");
  EXPECT_FALSE(limits().cpus);
  EXPECT_FALSE(limits().memory_bytes);
}

// Other groups' limits do not apply to this process.
TEST_F(Cgroup, ANeighbourIsNotLookedAt) {
  mounts(kVersion2);
  write("proc/self/cgroup", "0::/a\n");
  write("sys/fs/cgroup/b/cpu.max", "1000 100000\n");
  write("sys/fs/cgroup/b/memory.max", "1\n");
  write("sys/fs/cgroup/a/b/memory.max", "1\n");
  EXPECT_FALSE(limits().cpus);
  EXPECT_FALSE(limits().memory_bytes);
}

TEST_F(Cgroup, Version1BesideVersion2WithoutControllers) {
  mounts(kHybrid);
  write("proc/self/cgroup", "12:cpuset:/\n4:cpu,cpuacct:/a/b\n3:memory:/a\n0::/a/b\n");
  write("sys/fs/cgroup/cpu,cpuacct/cpu.cfs_quota_us", "-1\n");
  write("sys/fs/cgroup/cpu,cpuacct/cpu.cfs_period_us", "100000\n");
  write("sys/fs/cgroup/cpu,cpuacct/a/b/cpu.cfs_quota_us", "50000\n");
  write("sys/fs/cgroup/cpu,cpuacct/a/b/cpu.cfs_period_us", "100000\n");
  write("sys/fs/cgroup/memory/memory.limit_in_bytes", "9223372036854771712\n");
  write("sys/fs/cgroup/memory/a/memory.limit_in_bytes", "536870912\n");
  EXPECT_EQ(limits().cpus, 0.5);
  EXPECT_EQ(limits().cpus_from, path("sys/fs/cgroup/cpu,cpuacct/a/b/cpu.cfs_quota_us"));
  EXPECT_EQ(limits().memory_bytes, uint64_t{512} << 20);
}

TEST_F(Cgroup, Version1WithoutLimits) {
  mounts(kHybrid);
  write("proc/self/cgroup", "4:cpu,cpuacct:/\n3:memory:/\n");
  write("sys/fs/cgroup/cpu,cpuacct/cpu.cfs_quota_us", "-1\n");
  write("sys/fs/cgroup/cpu,cpuacct/cpu.cfs_period_us", "100000\n");
  write("sys/fs/cgroup/memory/memory.limit_in_bytes", "9223372036854771712\n");
  EXPECT_FALSE(limits().cpus);
  EXPECT_FALSE(limits().memory_bytes);
}

// docker run on a version 1 host: the mount starts at the container's group, but the group's name is the
// host's.
TEST_F(Cgroup, AMountThatBeginsAtTheGroupItself) {
  mounts(
      "40 30 0:28 /docker/0123 /sys/fs/cgroup/cpu,cpuacct ro - cgroup cgroup rw,cpu,cpuacct\n"
      "41 30 0:29 /docker/0123 /sys/fs/cgroup/memory ro - cgroup cgroup rw,memory\n");
  write("proc/self/cgroup", "4:cpu,cpuacct:/docker/0123\n3:memory:/docker/0123/inner\n");
  write("sys/fs/cgroup/cpu,cpuacct/cpu.cfs_quota_us", "300000\n");
  write("sys/fs/cgroup/cpu,cpuacct/cpu.cfs_period_us", "100000\n");
  write("sys/fs/cgroup/memory/memory.limit_in_bytes", "2000000\n");
  write("sys/fs/cgroup/memory/inner/memory.limit_in_bytes", "1000000\n");
  EXPECT_EQ(limits().cpus, 3.0);
  EXPECT_EQ(limits().memory_bytes, 1000000u);
}

// The group's name is outside the mount, as after leaving a namespace. Then only the mount counts.
TEST_F(Cgroup, AGroupThatTheMountDoesNotShow) {
  mounts(kVersion2);
  write("proc/self/cgroup", "0::/../other\n");
  write("sys/fs/cgroup/memory.max", "3000000\n");
  write("sys/fs/other/memory.max", "1\n");
  EXPECT_EQ(limits().memory_bytes, 3000000u);
}

TEST_F(Cgroup, AMountPointWithASpaceInIt) {
  mounts("30 24 0:26 / /my\\040groups rw - cgroup2 cgroup2 rw\n");
  write("proc/self/cgroup", "0::/\n");
  write("my groups/memory.max", "1000000\n");
  EXPECT_EQ(limits().memory_bytes, 1000000u);
}

TEST_F(Cgroup, FilesThatMakeNoSenseAreNoLimit) {
  mounts(std::string("nonsense\n - cgroup2 x\n") + kVersion2);
  write("proc/self/cgroup", "nonsense\n0::/\n\n");
  write("sys/fs/cgroup/cpu.max", "-5 0\n");
  write("sys/fs/cgroup/memory.max", "\n");
  EXPECT_FALSE(limits().cpus);
  EXPECT_FALSE(limits().memory_bytes);
}

TEST(UsableCpus, AreTheQuotaRoundedUpWithinWhatIsThere) {
  const uint32_t visible = std::thread::hardware_concurrency();
  EXPECT_EQ(usable_cpus({}), visible);
  EXPECT_EQ(usable_cpus({.cpus = 0.1, .cpus_from = "", .memory_bytes = {}, .memory_from = ""}), 1u);
  EXPECT_EQ(usable_cpus({.cpus = visible - 0.5, .cpus_from = "", .memory_bytes = {}, .memory_from = ""}),
            visible);
  EXPECT_EQ(usable_cpus({.cpus = 1e6, .cpus_from = "", .memory_bytes = {}, .memory_from = ""}), visible);
}

}  // namespace
}  // namespace candela
