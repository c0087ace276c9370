// What Mesa's software driver has to be told before Vulkan starts.
#pragma once

#include <filesystem>
#include <optional>

namespace candela {

// The CPUs that this process's cgroup may use at once, by cpu.max (version 2) or cpu.cfs_quota_us (version 1)
// of the group and those above it; nothing where there is no quota. `root` stands for "/" in tests.
std::optional<double> cgroup_cpus(const std::filesystem::path& root = "/");

// Sets, where the user has not: LP_NUM_THREADS to the cgroup's CPUs, rounded up, when those are fewer than
// the visible ones (lavapipe counts only the latter); NODEVICE_SELECT=1, which keeps Mesa's device-select
// layer from reordering devices. Calls setenv: before other threads read the environment.
void prepare_driver_environment();

}  // namespace candela
