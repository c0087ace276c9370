// The memory budget: how a server divides the memory that its control group allows.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <string>

#include "server/base/process.h"

namespace candela {

inline constexpr uint64_t kDefaultMemoryBudgetBytes = uint64_t{2} << 30;

// The memory quota of gRPC for so many sessions and calls: for what they sent and the server has not read
// yet, and something for connections. A session and a call beside it have what MemoryBudget::most_sessions
// leaves for them.
size_t grpc_quota_bytes(uint32_t sessions, uint32_t calls);

struct MemoryBudget {
  uint64_t bytes = kDefaultMemoryBudgetBytes;  // for textures
  std::string from;                            // where `bytes` comes from, for the log
  // The remaining memory is enough for this many sessions and as many calls; at least 1.
  uint32_t most_sessions = std::numeric_limits<uint32_t>::max();
  bool beyond_the_limit =
      false;  // more than the group allows: the process would be killed before it refuses a frame
};

// `asked` is the memory for textures. 0 means the default, or a share of the group's memory limit, in whole
// MiB, if that is less.
MemoryBudget choose_memory_budget(uint64_t asked, const CgroupLimits& limits);

}  // namespace candela
