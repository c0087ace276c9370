// The process: its processors, memory and descriptors as the system limits them, its environment and its end.
#pragma once

#include <unistd.h>

#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <optional>
#include <string>

#include "absl/status/status.h"

namespace candela {

// The addresses that a server needs. The threads of the driver and of gRPC reserve far more than they use.
uint64_t server_bytes();

// The addresses that a session with a running server needs.
uint64_t session_bytes();

// RESOURCE_EXHAUSTED if ulimit -v allows this process less than `bytes`. `what` needs them: "the built-in
// server". Without this check libraries would end the process when they find no memory.
absl::Status check_address_space(uint64_t bytes, const std::string& what, const std::string& way_out);

// The CPU and memory limits of the control group that this process runs in, for example a container's.

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

// The file descriptors of this process.

// Raises the soft limit to the hard limit. Affects the whole process; programs with select() need the low
// one.
void raise_descriptor_limit();

// FAILED_PRECONDITION, with what to do, if the soft limit is too low to start.
absl::Status check_descriptor_limit();

// The soft limit.
uint64_t descriptor_limit();

// The number that is open now.
uint64_t open_descriptors();

// The numbers that may be open at once. The rest, three eighths of what is left, is for files, the device and
// gRPC itself.
struct DescriptorBudget {
  uint64_t limit = 0;
  uint32_t connections = 0;        // of clients; at least 1
  uint32_t probe_connections = 0;  // to the metrics port; at least 1
};

// Divides what is left. `asked` is the number of connections that the operator wants; 0: 4096.
DescriptorBudget choose_descriptors(uint32_t asked, uint64_t limit = descriptor_limit(),
                                    uint64_t open = open_descriptors());

// Environment variables for Mesa's drivers, set before Vulkan starts.

// Sets two variables unless the user has set them:
// - LP_NUM_THREADS to usable_cpus(), at most lavapipe's own limit of 32, if fewer CPUs are usable than
// visible.
//   lavapipe itself counts the visible ones.
// - NODEVICE_SELECT=1, which keeps Mesa's device-select layer from reordering devices.
// Calls setenv, so call it before other threads read the environment.
void prepare_driver_environment();

// The end of candela and of candelad.

// Ends the process at once, with its output written. exit() would also clean up OpenSSL, while a thread of
// gRPC that is about to end still uses it: https://github.com/grpc/grpc/issues/38539.
[[noreturn]] inline void end_process(int code) {
  std::fflush(nullptr);
  _exit(code);
}

}  // namespace candela
