#include "server/memory_budget.h"

#include <algorithm>

#include "absl/strings/str_format.h"
#include "server/base/words.h"

namespace candela {
namespace {

constexpr uint64_t kMiB = uint64_t{1} << 20;

// The share of the memory limit that textures get by default.
constexpr uint64_t kShareNumerator = 3;
constexpr uint64_t kShareDenominator = 8;
// Memory in addition to textures, measured with lavapipe. The process: its shaders and what the allocator
// keeps. Each session, and a call beside it: what gRPC holds of them, and the rest.
constexpr uint64_t kProcessBytes = 320 * kMiB;
constexpr uint64_t kSessionBytes = 12 * kMiB;
// gRPC's own for its connections.
constexpr uint64_t kConnectionsBytes = 64 * kMiB;

}  // namespace

size_t grpc_quota_bytes(uint32_t sessions, uint32_t calls) {
  return std::max(sessions, calls) * size_t{kSessionBytes} + kConnectionsBytes;
}

MemoryBudget choose_memory_budget(uint64_t asked, const CgroupLimits& limits) {
  MemoryBudget budget{.from = "the default"};
  if (asked != 0) {
    budget.bytes = asked;
    budget.from = "--memory-budget";
  }
  if (!limits.memory_bytes) return budget;
  const uint64_t limit = *limits.memory_bytes;
  const uint64_t share = std::max(kMiB, limit / kShareDenominator * kShareNumerator / kMiB * kMiB);
  if (asked == 0 && share < kDefaultMemoryBudgetBytes) {
    budget.bytes = share;
    budget.from = absl::StrFormat("3/8 of the %s in %s", format_bytes(limit), limits.memory_from);
  }
  const uint64_t taken = budget.bytes + kProcessBytes;
  const uint64_t sessions = taken < limit ? (limit - taken) / kSessionBytes : 0;
  budget.most_sessions = static_cast<uint32_t>(std::clamp<uint64_t>(sessions, 1, budget.most_sessions));
  budget.beyond_the_limit = budget.bytes > limit;
  return budget;
}

}  // namespace candela
