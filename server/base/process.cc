#include "server/base/process.h"

#include <sys/resource.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <limits>
#include <map>
#include <string>
#include <system_error>
#include <thread>
#include <vector>

#include "absl/strings/numbers.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_split.h"
#include "absl/strings/string_view.h"

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

namespace {

namespace fs = std::filesystem;

// Version 1 writes "no limit" as the largest number of whole pages.
constexpr uint64_t kNoMemoryLimit = uint64_t{1} << 62;

// A mounted hierarchy.
struct Mount {
  fs::path point;
  std::string top;  // the group that appears at the mount point
  bool version2 = false;
  std::vector<std::string> controllers;  // of version 1
};

// mountinfo writes space, tab, newline and backslash as \ooo.
std::string unescape(absl::string_view text) {
  std::string plain;
  for (size_t i = 0; i < text.size(); ++i) {
    if (text[i] == '\\' && i + 3 < text.size()) {
      plain += static_cast<char>((text[i + 1] - '0') * 64 + (text[i + 2] - '0') * 8 + (text[i + 3] - '0'));
      i += 3;
    } else {
      plain += text[i];
    }
  }
  return plain;
}

// "ID PARENT DEVICE TOP POINT OPTIONS [OPTIONAL...] - TYPE SOURCE SUPER-OPTIONS".
std::vector<Mount> cgroup_mounts(const fs::path& root) {
  std::vector<Mount> mounts;
  std::ifstream file(root / "proc/self/mountinfo");
  for (std::string line; std::getline(file, line);) {
    const std::pair<std::string, std::string> halves = absl::StrSplit(line, absl::MaxSplits(" - ", 1));
    const std::vector<std::string> left = absl::StrSplit(halves.first, ' ');
    const std::vector<std::string> right = absl::StrSplit(halves.second, ' ');
    if (left.size() < 6 || right.size() < 3) continue;
    if (right[0] != "cgroup" && right[0] != "cgroup2") continue;
    mounts.push_back({root / fs::path(unescape(left[4])).relative_path(), unescape(left[3]),
                      right[0] == "cgroup2", absl::StrSplit(right[2], ',')});
  }
  return mounts;
}

// The process's group for each controller; the key for version 2 is "". A line is
// "HIERARCHY:CONTROLLERS:/PATH".
std::map<std::string, std::string> own_groups(const fs::path& root) {
  std::map<std::string, std::string> groups;
  std::ifstream file(root / "proc/self/cgroup");
  for (std::string line; std::getline(file, line);) {
    const std::vector<std::string> parts = absl::StrSplit(line, absl::MaxSplits(':', 2));
    if (parts.size() != 3) continue;
    for (const absl::string_view controller : absl::StrSplit(parts[1], ',')) {
      groups[std::string(controller)] = parts[2];
    }
  }
  return groups;
}

// The folders of `group` and its ancestors that `mount` shows. A container's mount often starts at its own
// group, although the group's name is the host's.
std::vector<fs::path> visible_folders(const Mount& mount, const std::string& group) {
  std::vector<fs::path> folders{mount.point};
  const fs::path below = fs::path(group).lexically_relative(mount.top);
  if (below.empty() || *below.begin() == ".." || *below.begin() == ".") return folders;
  for (const fs::path& part : below) folders.push_back(folders.back() / part);
  return folders;
}

std::optional<double> number_in(const fs::path& path) {
  double number = 0;
  if (!(std::ifstream(path) >> number) || number <= 0) return std::nullopt;
  return number;
}

std::optional<uint64_t> bytes_in(const fs::path& path) {
  uint64_t bytes = 0;
  if (!(std::ifstream(path) >> bytes) || bytes >= kNoMemoryLimit) return std::nullopt;
  return bytes;
}

// "QUOTA PERIOD" in microseconds, or "max PERIOD".
std::optional<double> cpu_max(const fs::path& path) {
  double quota = 0;
  double period = 0;
  if (!(std::ifstream(path) >> quota >> period) || quota <= 0 || period <= 0) return std::nullopt;
  return quota / period;
}

// A quota of -1 means no limit.
std::optional<double> cfs_quota(const fs::path& folder) {
  const std::optional<double> quota = number_in(folder / "cpu.cfs_quota_us");
  const std::optional<double> period = number_in(folder / "cpu.cfs_period_us");
  if (!quota || !period) return std::nullopt;
  return *quota / *period;
}

template <typename Value>
void keep_least(std::optional<Value> value, const fs::path& from, std::optional<Value>& least,
                std::string& least_from) {
  if (!value || (least && *least <= *value)) return;
  least = value;
  least_from = from.string();
}

}  // namespace

CgroupLimits read_cgroup_limits(const fs::path& root) {
  CgroupLimits limits;
  const std::map<std::string, std::string> groups = own_groups(root);
  const auto each_folder = [&groups](const Mount& mount, const std::string& controller, const auto& look) {
    const auto group = groups.find(controller);
    if (group == groups.end()) return;
    for (const fs::path& folder : visible_folders(mount, group->second)) look(folder);
  };
  const auto keep_cpus = [&limits](std::optional<double> cpus, const fs::path& from) {
    keep_least(cpus, from, limits.cpus, limits.cpus_from);
  };
  const auto keep_memory = [&limits](const fs::path& file) {
    keep_least(bytes_in(file), file, limits.memory_bytes, limits.memory_from);
  };
  for (const Mount& mount : cgroup_mounts(root)) {
    if (mount.version2) {
      each_folder(mount, "", [&](const fs::path& folder) {
        keep_cpus(cpu_max(folder / "cpu.max"), folder / "cpu.max");
        keep_memory(folder / "memory.max");
        keep_memory(folder / "memory.high");
      });
      continue;
    }
    const auto has = [&mount](const char* controller) {
      return std::find(mount.controllers.begin(), mount.controllers.end(), controller) !=
             mount.controllers.end();
    };
    if (has("cpu")) {
      each_folder(mount, "cpu",
                  [&](const fs::path& folder) { keep_cpus(cfs_quota(folder), folder / "cpu.cfs_quota_us"); });
    }
    if (has("memory")) {
      each_folder(mount, "memory",
                  [&](const fs::path& folder) { keep_memory(folder / "memory.limit_in_bytes"); });
    }
  }
  return limits;
}

uint32_t usable_cpus(const CgroupLimits& limits) {
  const uint32_t visible = std::max(1u, std::thread::hardware_concurrency());
  if (!limits.cpus || *limits.cpus >= visible) return visible;
  return std::max(1u, static_cast<uint32_t>(std::ceil(*limits.cpus)));
}

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
