// What the control group that this process runs in, a container's for instance, lets it use.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>

namespace candela {

struct CgroupLimits {
  std::optional<double> cpus;  // at once, fractions too
  std::string cpus_from;       // the file that says so
  std::optional<uint64_t> memory_bytes;
  std::string memory_from;
};

// The least limits of the process's group and of those above it that can be seen: cpu.max, memory.max and
// memory.high of version 2, cpu.cfs_quota_us and memory.limit_in_bytes of version 1, and both where both are
// mounted. Nothing where there is no limit or none can be read. `root` stands for "/" in tests.
CgroupLimits read_cgroup_limits(const std::filesystem::path& root = "/");

// How many threads have a CPU of their own: those this process may run on, or the group's CPUs, rounded up,
// where these are fewer; at least 1.
uint32_t usable_cpus(const CgroupLimits& limits = read_cgroup_limits());

}  // namespace candela
