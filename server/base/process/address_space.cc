#include "server/base/process/address_space.h"

#include <sys/resource.h>

#include <algorithm>
#include <thread>

#include "absl/strings/str_format.h"

namespace candela {
namespace {

constexpr uint64_t kMiB = uint64_t{1} << 20;

// gRPC and the software device start threads for each processor. Each reserves a stack, and a heap of 64 MiB.
uint64_t for_threads(uint64_t per_processor) {
  return std::max<uint64_t>(2, std::thread::hardware_concurrency()) * per_processor;
}

}  // namespace

uint64_t server_bytes() { return 1280 * kMiB + for_threads(160 * kMiB); }

uint64_t session_bytes() { return 512 * kMiB + for_threads(96 * kMiB); }

absl::Status check_address_space(uint64_t bytes, const std::string& what, const std::string& way_out) {
  rlimit limit{};
  if (getrlimit(RLIMIT_AS, &limit) != 0 || limit.rlim_cur == RLIM_INFINITY || limit.rlim_cur >= bytes) {
    return absl::OkStatus();
  }
  return absl::ResourceExhaustedError(
      absl::StrFormat("%s needs %d MiB of address space and ulimit -v allows %d MiB; raise it%s", what,
                      bytes / kMiB, limit.rlim_cur / kMiB, way_out));
}

}  // namespace candela
