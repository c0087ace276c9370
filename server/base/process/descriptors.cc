#include "server/base/process/descriptors.h"

#include <sys/resource.h>

#include <algorithm>
#include <filesystem>
#include <iterator>
#include <system_error>

#include "absl/strings/str_format.h"

namespace candela {

void raise_descriptor_limit() {
  rlimit limit{};
  if (getrlimit(RLIMIT_NOFILE, &limit) != 0) return;
  limit.rlim_cur = limit.rlim_max;
  setrlimit(RLIMIT_NOFILE, &limit);
}

absl::Status check_descriptor_limit() {
  constexpr uint64_t kLeast = 48;
  if (const uint64_t limit = descriptor_limit(); limit < kLeast) {
    return absl::FailedPreconditionError(
        absl::StrFormat("this process may open %d files and candelad needs at least %d; raise the limit "
                        "(ulimit -n, LimitNOFILE)",
                        limit, kLeast));
  }
  return absl::OkStatus();
}

uint64_t descriptor_limit() {
  rlimit limit{};
  return getrlimit(RLIMIT_NOFILE, &limit) == 0 ? limit.rlim_cur : 1024;
}

uint64_t open_descriptors() {
  std::error_code error;
  const std::filesystem::directory_iterator open("/proc/self/fd", error);
  return error ? 0 : static_cast<uint64_t>(std::distance(begin(open), end(open)));
}

DescriptorBudget choose_descriptors(uint32_t asked, uint64_t limit, uint64_t open) {
  constexpr uint64_t kConnections = 4096;
  constexpr uint64_t kProbes = 128;
  const uint64_t left = limit > open ? limit - open : 0;
  const auto part = [](uint64_t wanted, uint64_t most) {
    return static_cast<uint32_t>(std::max<uint64_t>(1, std::min(wanted, most)));
  };
  return {limit, part(asked == 0 ? kConnections : asked, left / 2), part(kProbes, left / 8)};
}

}  // namespace candela
