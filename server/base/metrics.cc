#include "server/base/metrics.h"

#include <prometheus/counter.h>
#include <prometheus/gauge.h>
#include <prometheus/histogram.h>
#include <prometheus/metric_family.h>
#include <prometheus/registry.h>
#include <prometheus/text_serializer.h>
#include <sys/resource.h>
#include <unistd.h>

#include <atomic>
#include <cstdint>
#include <ctime>
#include <fstream>
#include <iterator>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/strings/ascii.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_split.h"
#include "absl/strings/string_view.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include "server/base/log.h"
#include "server/base/process.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

// What Prometheus's client libraries say about a process: process_*.

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

// CPU time, memory, descriptors, threads and start time of this process, as they are now. What the kernel
// does not tell is left out. Any thread.
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

using prometheus::BuildCounter;
using prometheus::BuildGauge;
using prometheus::BuildHistogram;
using prometheus::Counter;
using prometheus::Family;
using prometheus::Gauge;
using prometheus::Histogram;

// Seconds. A pass of a small frame takes a tenth of a millisecond; verifying a large frame takes some
// seconds.
const Histogram::BucketBoundaries kStageSeconds = {0.0001, 0.00025, 0.0005, 0.001, 0.0025, 0.005, 0.01, 0.025,
                                                   0.05,   0.1,     0.25,   0.5,   1.0,    2.5,   5.0,  10.0};

// The results that exist from the start, at 0.
constexpr absl::StatusCode kFrameResults[] = {
    absl::StatusCode::kOk,       absl::StatusCode::kCancelled,       absl::StatusCode::kDeadlineExceeded,
    absl::StatusCode::kInternal, absl::StatusCode::kInvalidArgument, absl::StatusCode::kUnavailable,
    absl::StatusCode::kAborted,
};

std::string word(absl::StatusCode code) { return absl::AsciiStrToLower(absl::StatusCodeToString(code)); }

const char* word(Rejection reason) {
  switch (reason) {
    case Rejection::kCalls:
      return "calls";
    case Rejection::kSessions:
      return "sessions";
    case Rejection::kDraining:
      return "draining";
    case Rejection::kMemory:
      return "memory";
    case Rejection::kSize:
      return "size";
    case Rejection::kRequest:
      return "request";
    case Rejection::kToken:
      return "token";
    case Rejection::kAccess:
      return "access";
  }
  return "other";
}

}  // namespace

struct Metrics::Impl final : prometheus::Collectable {
  prometheus::Registry registry;
  Family<Histogram>& stages =
      BuildHistogram()
          .Name("candela_frame_stage_duration_seconds")
          .Help("Duration of each stage of a frame; device time if the stage runs on the device")
          .Register(registry);
  Family<Counter>& frames = BuildCounter()
                                .Name("candela_frames_total")
                                .Help("Frames that got memory, by the status that they ended with")
                                .Register(registry);
  Family<Counter>& rejections =
      BuildCounter()
          .Name("candela_rejections_total")
          .Help("Calls, sessions and frames refused before they had memory, by reason")
          .Register(registry);
  Family<Counter>& bytes = BuildCounter()
                               .Name("candela_bytes_total")
                               .Help("Message bytes of calls with frames, in and out of the server")
                               .Register(registry);
  Counter& bytes_in = bytes.Add({{"direction", "in"}});
  Counter& bytes_out = bytes.Add({{"direction", "out"}});
  Counter& device_rebuilds = BuildCounter()
                                 .Name("candela_device_rebuilds_total")
                                 .Help("Devices reopened after a loss")
                                 .Register(registry)
                                 .Add({});
  Gauge& sessions = BuildGauge().Name("candela_sessions").Help("Open sessions").Register(registry).Add({});
  Gauge& serving = BuildGauge()
                       .Name("candela_serving")
                       .Help("1 if health says SERVING, else 0")
                       .Register(registry)
                       .Add({});
  Gauge& queue_frames = BuildGauge()
                            .Name("candela_queue_frames")
                            .Help("Frames waiting for the device")
                            .Register(registry)
                            .Add({});
  Family<Gauge>& memory =
      BuildGauge()
          .Name("candela_memory_bytes")
          .Help("Memory of the texture pool, and of frames in flight with the files made of them")
          .Register(registry);
  Gauge& memory_in_use = memory.Add({{"pool", "textures_in_use"}});
  Gauge& memory_idle = memory.Add({{"pool", "textures_idle"}});
  Gauge& memory_frames = memory.Add({{"pool", "frames"}});
  Gauge& memory_budget = BuildGauge()
                             .Name("candela_memory_budget_bytes")
                             .Help("Limit of the texture pool, and of frames in flight")
                             .Register(registry)
                             .Add({});
  Gauge& environments = BuildGauge()
                            .Name("candela_environment_bytes")
                            .Help("Texture memory of the environments that are kept")
                            .Register(registry)
                            .Add({});
  Gauge& environment_budget = BuildGauge()
                                  .Name("candela_environment_budget_bytes")
                                  .Help("Limit of the environments that are kept")
                                  .Register(registry)
                                  .Add({});

  Gauge& connections =
      BuildGauge().Name("candela_connections").Help("Open connections of clients").Register(registry).Add({});
  Family<Counter>& refused = BuildCounter()
                                 .Name("candela_connections_refused_total")
                                 .Help("Connections closed as soon as they were accepted, by reason")
                                 .Register(registry);
  Counter& refused_at_limit = refused.Add({{"reason", "limit"}});
  Counter& refused_without_descriptor = refused.Add({{"reason", "descriptors"}});
  Counter& log_lines_lost =
      BuildCounter()
          .Name("candela_log_lines_lost_total")
          .Help("Lines of the log that nobody read in time, or that could not be written")
          .Register(registry)
          .Add({});

  Family<Gauge>& certificate_expiry =
      BuildGauge()
          .Name("candela_certificate_expiry_timestamp_seconds")
          .Help("When the server's TLS certificate expires, in seconds since 1970; absent without one")
          .Register(registry);

  // At the start the server is alive but not ready.
  std::atomic<bool> ready = false;
  std::atomic<bool> live = true;

  mutable absl::Mutex mutex;
  std::function<Sample()> sampler ABSL_GUARDED_BY(mutex);

  std::vector<prometheus::MetricFamily> Collect() const override {
    {
      const absl::MutexLock lock(&mutex);
      const Sample sample = sampler ? sampler() : Sample();
      queue_frames.Set(static_cast<double>(sample.queue_frames));
      memory_in_use.Set(static_cast<double>(sample.memory_in_use_bytes));
      memory_idle.Set(static_cast<double>(sample.memory_idle_bytes));
      memory_frames.Set(static_cast<double>(sample.memory_frames_bytes));
      memory_budget.Set(static_cast<double>(sample.memory_budget_bytes));
      environments.Set(static_cast<double>(sample.environment_bytes));
      environment_budget.Set(static_cast<double>(sample.environment_budget_bytes));
      connections.Set(static_cast<double>(sample.connections));
      log_lines_lost.Increment(static_cast<double>(candela::log_lines_lost()) - log_lines_lost.Value());
      if (sample.certificate_expires) {
        certificate_expiry.Add({}).Set(
            absl::ToDoubleSeconds(*sample.certificate_expires - absl::UnixEpoch()));
      }
    }
    std::vector<prometheus::MetricFamily> all = registry.Collect();
    for (prometheus::MetricFamily& family : process_metrics()) all.push_back(std::move(family));
    return all;
  }
};

Metrics::Metrics(const std::string& version, const std::string& device, const std::string& driver,
                 const std::string& passes)
    : impl_(std::make_shared<Impl>()) {
  BuildGauge()
      .Name("candela_build_info")
      .Help("Version, device, driver and who makes the passes, as labels; always 1")
      .Register(impl_->registry)
      .Add({{"version", version}, {"device", device}, {"driver", driver}, {"passes", passes}})
      .Set(1);
  BuildGauge()
      .Name("candela_start_time_seconds")
      .Help("Start time of this server, in seconds since 1970")
      .Register(impl_->registry)
      .Add({})
      .Set(absl::ToDoubleSeconds(absl::Now() - absl::UnixEpoch()));
  // Create every counter at 0: Prometheus does not count the step from an absent counter as an increase.
  for (const absl::StatusCode code : kFrameResults) impl_->frames.Add({{"result", word(code)}});
  for (int i = 0; i <= static_cast<int>(Rejection::kAccess); ++i) {
    impl_->rejections.Add({{"reason", word(static_cast<Rejection>(i))}});
  }
  impl_->stages.Add({{"stage", "queue"}}, kStageSeconds);  // every frame has this stage
}

Metrics::~Metrics() = default;

void Metrics::stage(absl::string_view stage, absl::Duration time) {
  impl_->stages.Add({{"stage", std::string(stage)}}, kStageSeconds).Observe(absl::ToDoubleSeconds(time));
}

void Metrics::frame_ended(absl::StatusCode code) { impl_->frames.Add({{"result", word(code)}}).Increment(); }

void Metrics::rejected(Rejection reason) { impl_->rejections.Add({{"reason", word(reason)}}).Increment(); }
void Metrics::connection_refused(ConnectionRefusal reason) {
  (reason == ConnectionRefusal::kLimit ? impl_->refused_at_limit : impl_->refused_without_descriptor)
      .Increment();
}

void Metrics::session_began() { impl_->sessions.Increment(); }
void Metrics::session_ended() { impl_->sessions.Decrement(); }
void Metrics::bytes_in(uint64_t bytes) { impl_->bytes_in.Increment(static_cast<double>(bytes)); }
void Metrics::bytes_out(uint64_t bytes) { impl_->bytes_out.Increment(static_cast<double>(bytes)); }
void Metrics::device_rebuilt() { impl_->device_rebuilds.Increment(); }

void Metrics::health(bool ready, bool live) {
  impl_->ready = ready;
  impl_->live = live;
  impl_->serving.Set(ready ? 1 : 0);
}

void Metrics::set_sampler(std::function<Sample()> sampler) {
  const absl::MutexLock lock(&impl_->mutex);
  impl_->sampler = std::move(sampler);
}

absl::StatusOr<std::unique_ptr<MetricsServer>> MetricsServer::start(const Metrics& metrics,
                                                                    const std::string& address,
                                                                    size_t max_connections, Clock& clock) {
  const auto yes_or_no = [](bool yes) {
    return yes ? HttpPages::Answer{200, "ok\n"} : HttpPages::Answer{503, "no\n"};
  };
  ASSIGN_OR_RETURN(
      std::unique_ptr<HttpPages> pages,
      HttpPages::start(
          address, max_connections, clock,
          {{"/metrics",
            [impl = metrics.impl_] {
              return HttpPages::Answer{200, prometheus::TextSerializer().Serialize(impl->Collect())};
            }},
           {"/livez", [impl = metrics.impl_, yes_or_no] { return yes_or_no(impl->live); }},
           {"/readyz", [impl = metrics.impl_, yes_or_no] { return yes_or_no(impl->ready); }}}));
  return std::unique_ptr<MetricsServer>(new MetricsServer(std::move(pages)));
}

MetricsServer::MetricsServer(std::unique_ptr<HttpPages> pages) : pages_(std::move(pages)) {}

MetricsServer::~MetricsServer() = default;

}  // namespace candela
