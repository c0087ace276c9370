#include "server/base/driver_environment.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <sstream>
#include <string>
#include <thread>

namespace candela {
namespace {

namespace fs = std::filesystem;

// lavapipe takes no more than this.
constexpr double kMaxDriverThreads = 32;

// cpu.max: "QUOTA PERIOD" in microseconds, or "max PERIOD".
std::optional<double> read_version2(const fs::path& group) {
  std::ifstream file(group / "cpu.max");
  double quota = 0;
  double period = 0;
  if (!(file >> quota >> period) || quota <= 0 || period <= 0) return std::nullopt;
  return quota / period;
}

// cpu.cfs_quota_us, -1 for none, and cpu.cfs_period_us.
std::optional<double> read_version1(const fs::path& group) {
  double quota = 0;
  double period = 0;
  if (!(std::ifstream(group / "cpu.cfs_quota_us") >> quota) || quota <= 0) return std::nullopt;
  if (!(std::ifstream(group / "cpu.cfs_period_us") >> period) || period <= 0) return std::nullopt;
  return quota / period;
}

// The least of the quotas from `mount`/`group` up to `mount`. A container sees its own group as the mount
// itself, while its name may still be the host's: names that do not exist are passed over.
template <typename Read>
std::optional<double> least_quota(const fs::path& mount, const fs::path& group, Read read) {
  std::optional<double> least = read(mount);
  fs::path at = mount;
  for (const fs::path& part : group.relative_path()) {
    at /= part;
    if (const std::optional<double> quota = read(at)) least = std::min(*quota, least.value_or(*quota));
  }
  return least;
}

bool lists_cpu(const std::string& controllers) {
  std::istringstream list(controllers);
  for (std::string name; std::getline(list, name, ',');) {
    if (name == "cpu") return true;
  }
  return false;
}

}  // namespace

std::optional<double> cgroup_cpus(const fs::path& root) {
  const fs::path mounts = root / "sys/fs/cgroup";
  std::optional<double> least;
  const auto keep = [&least](std::optional<double> quota) {
    if (quota) least = std::min(*quota, least.value_or(*quota));
  };
  // "HIERARCHY:CONTROLLERS:/PATH"; version 2 is hierarchy 0 with no controllers.
  std::ifstream groups(root / "proc/self/cgroup");
  for (std::string line; std::getline(groups, line);) {
    const size_t first = line.find(':');
    const size_t second = first == std::string::npos ? first : line.find(':', first + 1);
    if (second == std::string::npos) continue;
    const std::string controllers = line.substr(first + 1, second - first - 1);
    const fs::path group = line.substr(second + 1);
    if (controllers.empty()) {
      keep(least_quota(mounts, group, read_version2));
    } else if (lists_cpu(controllers)) {
      keep(least_quota(mounts / "cpu", group, read_version1));
    }
  }
  return least;
}

void prepare_driver_environment() {
  constexpr int kKeepTheUsers = 0;
  const double visible = std::thread::hardware_concurrency();
  if (const std::optional<double> cpus = cgroup_cpus(); cpus && std::ceil(*cpus) < visible) {
    const double threads = std::clamp(std::ceil(*cpus), 1.0, kMaxDriverThreads);
    setenv("LP_NUM_THREADS", std::to_string(static_cast<int>(threads)).c_str(), kKeepTheUsers);
  }
  setenv("NODEVICE_SELECT", "1", kKeepTheUsers);
}

}  // namespace candela
