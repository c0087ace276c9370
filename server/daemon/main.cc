// candelad, the daemon: starts a server, handles its signals and stops it.
#include <grpc/grpc.h>
#include <malloc.h>
#include <pthread.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <thread>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/synchronization/notification.h"
#include "absl/time/clock.h"
#include "server/alarm_timers.h"
#include "server/base/clock.h"
#include "server/base/log.h"
#include "server/base/process.h"
#include "server/base/words.h"
#include "server/config.h"
#include "server/daemon/flags.h"
#include "server/daemon/service_manager.h"
#include "server/rpc/grpc_log.h"
#include "server/server.h"
#include "server/vulkan/device.h"

namespace candela {
namespace {

constexpr int kFailed = 1;
constexpr int kUsage = 2;
// A server may take this much longer to stop than its pre-drain and drain timeout before the process exits
// anyway.
constexpr absl::Duration kStopGrace = absl::Seconds(10);

// Handles SIGTERM and SIGINT on its own thread. The first signal drains the server. A second one, or a server
// that does not stop in time, ends the process.
class Signals {
 public:
  // Construct it before any other thread starts, so that every thread inherits the blocked signals.
  explicit Signals(absl::Duration stop_within) : stop_within_(stop_within) {
    sigemptyset(&set_);
    sigaddset(&set_, SIGTERM);
    sigaddset(&set_, SIGINT);
    pthread_sigmask(SIG_BLOCK, &set_, nullptr);
    thread_ = std::thread([this] { run(); });
  }
  ~Signals() {
    finished_.Notify();
    pthread_kill(thread_.native_handle(), SIGTERM);
    thread_.join();
  }

  void wait_for_stop() { stop_.WaitForNotification(); }
  // Does what a first SIGTERM does, but the process exits with a failure.
  void fail() {
    failed_ = true;
    pthread_kill(thread_.native_handle(), SIGTERM);
  }
  bool failed() const { return failed_; }
  // From now on, a stop that takes too long is a client's fault and not a failure.
  void nothing_in_flight() { nothing_in_flight_ = true; }

 private:
  void run() {
    int signal = 0;
    sigwait(&set_, &signal);
    if (finished_.HasBeenNotified()) return;
    log_event(LogLevel::kInfo, "draining",
              {{"because", failed_            ? "the device is lost or hangs"
                           : signal == SIGINT ? "SIGINT"
                                              : "SIGTERM"}});
    stop_.Notify();
    const absl::Time end = absl::Now() + stop_within_;
    siginfo_t from{};
    int second = 0;
    do {  // SIGSTOP and SIGCONT interrupt this call; fail() asks for the drain that is under way
      const timespec left = absl::ToTimespec(std::max(end - absl::Now(), absl::ZeroDuration()));
      second = sigtimedwait(&set_, &from, &left);
      if (finished_.HasBeenNotified()) return;
    } while (second < 0 ? errno == EINTR : from.si_pid == getpid());
    if (second < 0 && nothing_in_flight_) {
      log_event(LogLevel::kWarning, "stopped with an open connection, because its client does not read");
      end_at_once(failed_ ? kFailed : 0);
    }
    log_event(LogLevel::kError, second > 0 ? "ended by a second signal" : "did not stop in time");
    end_at_once(kFailed);
  }
  // Without stdout, unlike end_process(): a full pipe may be why the other threads did not stop.
  [[noreturn]] static void end_at_once(int code) {
    flush_log();
    _exit(code);
  }

  const absl::Duration stop_within_;
  sigset_t set_;
  absl::Notification stop_;
  absl::Notification finished_;
  std::atomic<bool> nothing_in_flight_ = false;
  std::atomic<bool> failed_ = false;
  std::thread thread_;
};

int fail(const absl::Status& status, int code) {
  flush_log();
  absl::FPrintF(stderr, "candelad: %s\n", status.message());
  return code;
}

int print_devices() {
  prepare_driver_environment();
  const absl::StatusOr<std::vector<DeviceSummary>> devices = list_devices();
  if (!devices.ok()) return fail(devices.status(), kFailed);
  for (const DeviceSummary& device : *devices) {
    absl::PrintF("%d  %s  (%s, %s, Vulkan %s)%s\n", device.index, device.name, device.type, device.driver,
                 device.api_version,
                 device.unusable.empty() ? "" : absl::StrCat("  unusable: ", device.unusable));
  }
  return 0;
}

// Makes the allocator keep the memory of freed messages. Each frame's messages take megabytes. Returning them
// to the system and faulting them in again for the next frame cost a stream 6 % of its frames. Each arena
// keeps some memory, so a process with a memory limit gets only a few arenas.
void keep_freed_memory() {
  constexpr int kLargestKept = 4 << 20;  // bytes of one block: covers a message, but not a large texture
  constexpr int kKept = 64 << 20;        // bytes per arena
  mallopt(M_MMAP_THRESHOLD, kLargestKept);
  mallopt(M_TRIM_THRESHOLD, kKept);
  constexpr int kFewArenas = 2;
  if (read_cgroup_limits().memory_bytes) mallopt(M_ARENA_MAX, kFewArenas);
}

// A variable with a typing error would otherwise go unnoticed.
void warn_of_unknown_variables() {
  for (const auto& [name, words] : unknown_variables(variable_names())) {
    log_event(LogLevel::kWarning, "nothing reads this environment variable",
              {{"name", name}, {"hint", words}});
  }
}

int serve(const Invocation& invocation) {
  // What cannot be written fails with an error: a closed pipe, and a file beyond the limit of its size.
  std::signal(SIGPIPE, SIG_IGN);
  std::signal(SIGXFSZ, SIG_IGN);
  start_logging({invocation.config.log_level, invocation.config.log_json});
  warn_of_unknown_variables();
  raise_descriptor_limit();
  if (absl::Status status = check_descriptor_limit(); !status.ok()) return fail(status, kFailed);
  if (absl::Status status = check_address_space(server_bytes(), "candelad", ""); !status.ok()) {
    return fail(status, kFailed);
  }
  keep_freed_memory();
  Signals signals(invocation.config.pre_drain + invocation.config.drain_timeout + kStopGrace);
  // gRPC stays until the process ends. Its own end waits for its threads, and one of them polls for up to
  // 10 s after a write that had to wait.
  grpc_init();
  send_grpc_messages_to_log();
  tell_service_manager("STATUS=starting");
  RealClock clock;
  AlarmTimers timers;
  Config config = invocation.config;
#ifdef CANDELA_HANG_AFTER
  config.hang_limit = absl::Seconds(15);
#endif
  absl::StatusOr<std::unique_ptr<Server>> server =
      Server::start(config, clock, timers, [&signals] { signals.fail(); });
  if (!server.ok()) return fail(server.status(), kFailed);
  const std::string addresses = absl::StrJoin((*server)->addresses(), " ");
  absl::PrintF("listening on %s\n", addresses);
  std::fflush(stdout);
  log_event(LogLevel::kInfo, "serving",
            {{"address", addresses},
             {"device", (*server)->device_name()},
             {"metrics", (*server)->metrics_address()}});
  tell_service_manager("READY=1\nSTATUS=serving on " + addresses);
  const Watchdog watchdog(clock, [s = server->get()] { return s->alive(); });
#ifdef CANDELA_HANG_AFTER
  (*server)->hang_device(CANDELA_HANG_AFTER);  // only in a test's build of candelad
#endif
#ifdef CANDELA_LOSE_DEVICES
  (*server)->lose_device(CANDELA_LOSE_DEVICES);  // only in a test's build of candelad
#endif
  signals.wait_for_stop();
  tell_service_manager("STOPPING=1\nSTATUS=draining");
  (*server)->drain_and_stop([&signals] { signals.nothing_in_flight(); });
  log_event(LogLevel::kInfo, "stopped");
  flush_log();
  if (!signals.failed()) return 0;
  // The device may hang, and then neither it nor its driver can be taken down.
  end_process(kFailed);
}

int run(int argc, char** argv) {
  const absl::StatusOr<Invocation> invocation = parse_invocation(argc, argv);
  if (!invocation.ok()) return fail(invocation.status(), kUsage);
  if (!invocation->text.empty()) {
    std::fputs(invocation->text.c_str(), stdout);
    return 0;
  }
  return invocation->list_devices ? print_devices() : serve(*invocation);
}

}  // namespace
}  // namespace candela

int main(int argc, char** argv) { candela::end_process(candela::run(argc, argv)); }
