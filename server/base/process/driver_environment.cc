#include "server/base/process/driver_environment.h"

#include <algorithm>
#include <cstdlib>
#include <string>
#include <thread>

#include "server/base/process/cgroup.h"

namespace candela {
namespace {

constexpr uint32_t kMaxDriverThreads = 32;

}  // namespace

void prepare_driver_environment() {
  constexpr int kKeepTheUsers = 0;
  if (const uint32_t cpus = usable_cpus(); cpus < std::thread::hardware_concurrency()) {
    setenv("LP_NUM_THREADS", std::to_string(std::min(cpus, kMaxDriverThreads)).c_str(), kKeepTheUsers);
  }
  setenv("NODEVICE_SELECT", "1", kKeepTheUsers);
}

}  // namespace candela
