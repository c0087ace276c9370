// The CPU and memory limits of the control group that this process runs in, for example a container's.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>

namespace candela {

struct CgroupLimits {
  std::optional<double> cpus;  // CPUs at once; may be a fraction
  std::string cpus_from;       // the file with this limit
  std::optional<uint64_t> memory_bytes;
  std::string memory_from;
};

// The lowest limits of the process's group and its visible ancestors. Reads cpu.max, memory.max and
// memory.high (version 2), and cpu.cfs_quota_us and memory.limit_in_bytes (version 1), whichever are mounted.
// A limit is absent if none is set or none can be read. Tests pass another `root` than "/".
CgroupLimits read_cgroup_limits(const std::filesystem::path& root = "/");

// The number of threads that can each have a CPU: the CPUs that this process may run on, or the group's CPU
// limit, rounded up, if that is less. At least 1.
uint32_t usable_cpus(const CgroupLimits& limits = read_cgroup_limits());

}  // namespace candela
