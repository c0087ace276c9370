// How a server divides the memory that its control group allows.
#pragma once

#include <cstdint>
#include <limits>
#include <string>

#include "server/base/cgroup.h"

namespace candela {

inline constexpr uint64_t kDefaultMemoryBudgetBytes = uint64_t{2} << 30;

// What one session may send before it is read. gRPC by itself lets it grow with the bandwidth, to tens of MiB
// that no budget knows of.
inline constexpr int kLookAheadBytes = 4 << 20;

struct MemoryBudget {
  uint64_t bytes = kDefaultMemoryBudgetBytes;  // for textures
  std::string from;                            // why so much, in words
  // How many sessions, and how many calls, what is left is enough for; at least 1.
  uint32_t most_sessions = std::numeric_limits<uint32_t>::max();
  bool beyond_the_limit = false;  // of the group: the process would be killed before it refuses
};

// `asked` for textures, or, where that is 0, the default and at most a share of the group's memory, whole
// MiB.
MemoryBudget choose_memory_budget(uint64_t asked, const CgroupLimits& limits);

}  // namespace candela
