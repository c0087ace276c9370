#include "server/base/driver_environment.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <fstream>

namespace candela {
namespace {

namespace fs = std::filesystem;

class CgroupTest : public ::testing::Test {
 protected:
  void SetUp() override { fs::remove_all(root_); }
  void TearDown() override { fs::remove_all(root_); }
  void write(const std::string& path, const std::string& text) {
    fs::create_directories((root_ / path).parent_path());
    std::ofstream(root_ / path) << text;
  }

  // One a process: ctest may run several at once.
  const fs::path root_ = fs::path(::testing::TempDir()) / ("cgroup_test." + std::to_string(getpid()));
};

TEST_F(CgroupTest, NoGroupIsNoQuota) { EXPECT_FALSE(cgroup_cpus(root_)); }

TEST_F(CgroupTest, Version2InsideAContainer) {
  write("proc/self/cgroup", "0::/\n");
  write("sys/fs/cgroup/cpu.max", "150000 100000\n");
  EXPECT_EQ(cgroup_cpus(root_), 1.5);
}

TEST_F(CgroupTest, Version2TakesTheLeastQuotaUpToTheRoot) {
  write("proc/self/cgroup", "0::/a.slice/b.service\n");
  write("sys/fs/cgroup/a.slice/cpu.max", "200000 100000\n");
  write("sys/fs/cgroup/a.slice/b.service/cpu.max", "max 100000\n");
  EXPECT_EQ(cgroup_cpus(root_), 2.0);
}

TEST_F(CgroupTest, Version2WithoutQuota) {
  write("proc/self/cgroup", "0::/\n");
  write("sys/fs/cgroup/cpu.max", "max 100000\n");
  EXPECT_FALSE(cgroup_cpus(root_));
}

TEST_F(CgroupTest, Version1WithTheHostsNameForTheGroup) {
  write("proc/self/cgroup", "12:cpuset:/docker/0123\n4:cpu,cpuacct:/docker/0123\n0::/\n");
  write("sys/fs/cgroup/cpu/cpu.cfs_quota_us", "50000\n");
  write("sys/fs/cgroup/cpu/cpu.cfs_period_us", "100000\n");
  EXPECT_EQ(cgroup_cpus(root_), 0.5);
}

TEST_F(CgroupTest, Version1WithoutQuota) {
  write("proc/self/cgroup", "4:cpu,cpuacct:/\n");
  write("sys/fs/cgroup/cpu/cpu.cfs_quota_us", "-1\n");
  write("sys/fs/cgroup/cpu/cpu.cfs_period_us", "100000\n");
  EXPECT_FALSE(cgroup_cpus(root_));
}

}  // namespace
}  // namespace candela
