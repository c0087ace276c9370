#include "server/base/process_metrics.h"

#include <sys/resource.h>
#include <unistd.h>

#include <cstdint>
#include <ctime>
#include <fstream>
#include <iterator>
#include <optional>
#include <string>

#include "absl/strings/numbers.h"
#include "absl/strings/str_split.h"
#include "absl/strings/string_view.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include "server/base/process/descriptors.h"

namespace candela {
namespace {

using prometheus::ClientMetric;
using prometheus::MetricFamily;
using prometheus::MetricType;

struct ProcessStat {
  double cpu_seconds = 0;
  double threads = 0;
  double started_seconds = 0;  // after the machine's start
  double virtual_bytes = 0;
  double resident_bytes = 0;
};

// The fields of /proc/self/stat, see proc(5).
std::optional<ProcessStat> read_stat() {
  std::ifstream file("/proc/self/stat");
  const std::string text{std::istreambuf_iterator<char>(file), {}};
  const size_t name_end = text.rfind(')');  // the name may hold anything
  if (name_end == std::string::npos) return std::nullopt;
  const std::vector<absl::string_view> fields =
      absl::StrSplit(absl::string_view(text).substr(name_end + 1), ' ', absl::SkipEmpty());
  constexpr size_t kFirst = 3, kUserTime = 14, kSystemTime = 15, kThreads = 20, kStart = 22, kVirtual = 23,
                   kResident = 24;
  if (fields.size() <= kResident - kFirst) return std::nullopt;
  const auto number = [&](size_t field) {
    double value = 0;
    return absl::SimpleAtod(fields[field - kFirst], &value) ? value : 0;
  };
  const auto ticks = static_cast<double>(sysconf(_SC_CLK_TCK));
  return ProcessStat{.cpu_seconds = (number(kUserTime) + number(kSystemTime)) / ticks,
                     .threads = number(kThreads),
                     .started_seconds = number(kStart) / ticks,
                     .virtual_bytes = number(kVirtual),
                     .resident_bytes = number(kResident) * static_cast<double>(sysconf(_SC_PAGESIZE))};
}

// Seconds since 1970. Found once: the two clocks are read one after the other, and Prometheus counts changes.
double start_time(const ProcessStat& stat) {
  static const double start = [&] {
    timespec running{};
    clock_gettime(CLOCK_BOOTTIME, &running);
    const double since_boot =
        static_cast<double>(running.tv_sec) + 1e-9 * static_cast<double>(running.tv_nsec);
    return absl::ToDoubleSeconds(absl::Now() - absl::UnixEpoch()) - since_boot + stat.started_seconds;
  }();
  return start;
}

MetricFamily family(const char* name, const char* help, double value, MetricType type = MetricType::Gauge) {
  ClientMetric metric;
  (type == MetricType::Gauge ? metric.gauge.value : metric.counter.value) = value;
  return {name, help, type, {metric}};
}

}  // namespace

std::vector<MetricFamily> process_metrics() {
  std::vector<MetricFamily> all;
  if (const std::optional<ProcessStat> stat = read_stat()) {
    all.push_back(family("process_cpu_seconds_total", "CPU time of the process, user and system, in seconds",
                         stat->cpu_seconds, MetricType::Counter));
    all.push_back(
        family("process_resident_memory_bytes", "Resident memory of the process", stat->resident_bytes));
    all.push_back(
        family("process_virtual_memory_bytes", "Virtual memory of the process", stat->virtual_bytes));
    all.push_back(family("process_threads", "Threads of the process", stat->threads));
    all.push_back(family("process_start_time_seconds", "Start time of the process, in seconds since 1970",
                         start_time(*stat)));
  }
  rlimit memory{};
  if (getrlimit(RLIMIT_AS, &memory) == 0) {
    all.push_back(family("process_virtual_memory_max_bytes", "Limit of the virtual memory; -1: none",
                         memory.rlim_cur == RLIM_INFINITY ? -1 : static_cast<double>(memory.rlim_cur)));
  }
  const auto limit = static_cast<double>(descriptor_limit());
  // Without a descriptor to look with, all of them are open.
  const uint64_t open = open_descriptors();
  all.push_back(family("process_open_fds", "Open file descriptors of the process",
                       open == 0 ? limit : static_cast<double>(open - 1)));  // one of them looks
  all.push_back(family("process_max_fds", "Limit of the file descriptors of the process", limit));
  return all;
}

}  // namespace candela
