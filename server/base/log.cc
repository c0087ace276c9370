#include "server/base/log.h"

#include <poll.h>
#include <pthread.h>
#include <spdlog/async_logger.h>
#include <spdlog/details/thread_pool.h>
#include <spdlog/logger.h>
#include <spdlog/sinks/sink.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <csignal>
#include <functional>
#include <memory>
#include <nlohmann/json.hpp>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"

namespace candela {
namespace {

using Json = nlohmann::ordered_json;

// The queue in front of a reader that may sleep. With the longest lines it holds some 30 MiB, and 1 MiB
// usually.
constexpr size_t kQueuedLines = 4096;
constexpr size_t kMaxFieldBytes = 2048;

// A line waits this long for room in the queue, and an error until it is written. After a wait in vain none
// waits for a while: the reader sleeps.
constexpr absl::Duration kPatience = absl::Milliseconds(100);
constexpr absl::Duration kAfterAVainWait = absl::Seconds(10);
// At the end of the process, and how long the reader may take for each step of it.
constexpr absl::Duration kFlush = absl::Seconds(5);
constexpr absl::Duration kFlushStep = absl::Milliseconds(250);

// start_logging writes these once. They are never destroyed, because gRPC's threads log until the process
// ends, and a thread that writes to a pipe that nobody reads never ends.
class StderrSink;
spdlog::logger* g_logger = nullptr;
StderrSink* g_sink = nullptr;
spdlog::details::thread_pool* g_queue = nullptr;  // null if lines are written at once
bool g_json = false;
std::atomic<uint64_t> g_lines = 0;        // given to the logger
std::atomic<int64_t> g_next_wait_ns = 0;  // since 1970

constexpr const char* kLevelWords[] = {"debug", "info", "warning", "error", "off"};

spdlog::level::level_enum level_of(LogLevel level) {
  switch (level) {
    case LogLevel::kDebug:
      return spdlog::level::debug;
    case LogLevel::kInfo:
      return spdlog::level::info;
    case LogLevel::kWarning:
      return spdlog::level::warn;
    case LogLevel::kError:
      return spdlog::level::err;
    case LogLevel::kOff:
      break;
  }
  return spdlog::level::off;
}

// `text` as a JSON string on one line. Invalid UTF-8 is replaced.
std::string json_string(absl::string_view text) {
  return Json(std::string(text)).dump(-1, ' ', false, Json::error_handler_t::replace);
}

std::string shortened(absl::string_view text) {
  if (text.size() <= kMaxFieldBytes) return std::string(text);
  return absl::StrCat(text.substr(0, kMaxFieldBytes), "...");
}

std::string json_line(absl::string_view time, LogLevel level, absl::string_view event,
                      std::initializer_list<LogField> fields) {
  std::string line =
      absl::StrCat("{\"time\":", json_string(time), ",\"level\":", json_string(log_level_word(level)),
                   ",\"event\":", json_string(event));
  for (const LogField& field : fields) {
    absl::StrAppend(&line, ",", json_string(field.key), ":",
                    field.number ? field.value : json_string(shortened(field.value)));
  }
  return absl::StrCat(line, "}");
}

std::string text_line(absl::string_view time, LogLevel level, absl::string_view event,
                      std::initializer_list<LogField> fields) {
  std::string line = absl::StrCat(time, " ", log_level_word(level), " ", event);
  for (const LogField& field : fields) {
    if (field.value.empty()) continue;
    const std::string json = json_string(shortened(field.value));
    const bool plain = !absl::StrContains(field.value, ' ') && json.size() == field.value.size() + 2;
    absl::StrAppend(&line, " ", field.key, "=", plain ? field.value : json);
  }
  return line;
}

std::string line_of(LogLevel level, absl::string_view event, std::initializer_list<LogField> fields) {
  const std::string time = absl::FormatTime("%Y-%m-%dT%H:%M:%E3SZ", absl::Now(), absl::UTCTimeZone());
  return g_json ? json_line(time, level, event, fields) : text_line(time, level, event, fields);
}

// Writes all of `text` to stderr, however long that takes. Returns false on an error.
bool write_all(absl::string_view text) {
  while (!text.empty()) {
    const ssize_t count = write(STDERR_FILENO, text.data(), text.size());
    if (count >= 0) {
      text.remove_prefix(static_cast<size_t>(count));
    } else if (errno == EAGAIN) {  // somebody who shares the pipe made it non-blocking
      pollfd ready{STDERR_FILENO, POLLOUT, 0};
      poll(&ready, 1, -1);
    } else if (errno != EINTR) {
      return false;
    }
  }
  return true;
}

class StderrSink final : public spdlog::sinks::sink {
 public:
  void log(const spdlog::details::log_msg& message) override {
    const absl::MutexLock lock(&mutex_);
    const uint64_t lost = log_lines_lost();
    if (lost > told_ && write_all(absl::StrCat(
                            line_of(LogLevel::kWarning, "log lines lost",
                                    {{"lines", lost - told_}, {"hint", "nobody read the log fast enough"}}),
                            "\n"))) {
      told_ = lost;
    }
    const absl::string_view line(message.payload.data(), message.payload.size());
    if (!write_all(absl::StrCat(line, "\n"))) ++failed_;
    ++handled_;
  }
  void flush() override {}
  void set_pattern(const std::string&) override {}
  void set_formatter(std::unique_ptr<spdlog::formatter>) override {}

  uint64_t handled() const { return handled_; }
  uint64_t failed() const { return failed_; }

 private:
  absl::Mutex mutex_;
  uint64_t told_ ABSL_GUARDED_BY(mutex_) = 0;  // the lost lines that a line counts
  std::atomic<uint64_t> handled_ = 0;
  std::atomic<uint64_t> failed_ = 0;  // among the handled ones
};

uint64_t overrun() { return g_queue == nullptr ? 0 : g_queue->overrun_counter(); }

// True if the lines that were given before there were `lines` are written or lost.
bool is_done(uint64_t lines) { return g_sink->handled() + overrun() >= lines; }

void wait_for(const std::function<bool()>& done) {
  const absl::Time begin = absl::Now();
  if (done() || absl::ToUnixNanos(begin) < g_next_wait_ns) return;
  while (!done()) {
    if (absl::Now() - begin > kPatience) {
      g_next_wait_ns = absl::ToUnixNanos(absl::Now() + kAfterAVainWait);
      return;
    }
    absl::SleepFor(absl::Milliseconds(1));
  }
}

bool is_regular_file(int file) {
  struct stat about {};
  return fstat(file, &about) == 0 && S_ISREG(about.st_mode);
}

// The queue's thread takes no signals: they belong to the threads that wait for them.
std::shared_ptr<spdlog::details::thread_pool> make_queue() {
  sigset_t all;
  sigset_t before;
  sigfillset(&all);
  pthread_sigmask(SIG_BLOCK, &all, &before);
  auto queue = std::make_shared<spdlog::details::thread_pool>(kQueuedLines, 1);
  pthread_sigmask(SIG_SETMASK, &before, nullptr);
  return queue;
}

}  // namespace

LogField::LogField(absl::string_view k, double v) : key(k), value(absl::StrCat(v)), number(true) {}
LogField::LogField(absl::string_view k, int64_t v) : key(k), value(absl::StrCat(v)), number(true) {}
LogField::LogField(absl::string_view k, uint64_t v) : key(k), value(absl::StrCat(v)), number(true) {}

const char* log_level_word(LogLevel level) { return kLevelWords[static_cast<int>(level)]; }

absl::StatusOr<LogLevel> parse_log_level(absl::string_view word) {
  for (int level = 0; level <= static_cast<int>(LogLevel::kOff); ++level) {
    if (word == kLevelWords[level]) return static_cast<LogLevel>(level);
  }
  return absl::InvalidArgumentError(
      absl::StrFormat("'%s' is not one of debug, info, warning, error and off", word));
}

void start_logging(const LogOptions& options) {
  g_json = options.json;
  const auto sink = std::make_shared<StderrSink>();
  std::shared_ptr<spdlog::logger> logger;
  if (is_regular_file(STDERR_FILENO)) {
    logger = std::make_shared<spdlog::logger>("candela", sink);
  } else {
    static const auto& queue = *new std::shared_ptr<spdlog::details::thread_pool>(make_queue());
    g_queue = queue.get();
    logger = std::make_shared<spdlog::async_logger>("candela", sink, queue,
                                                    spdlog::async_overflow_policy::overrun_oldest);
  }
  logger->set_level(level_of(options.level));
  g_sink = sink.get();
  static const auto& kept = *new std::shared_ptr<spdlog::logger>(std::move(logger));
  g_logger = kept.get();
}

void log_event(LogLevel level, absl::string_view event, std::initializer_list<LogField> fields) {
  if (g_logger == nullptr || !g_logger->should_log(level_of(level))) return;
  if (g_queue != nullptr) wait_for([] { return g_queue->queue_size() < kQueuedLines; });
  g_logger->log(level_of(level), line_of(level, event, fields));
  const uint64_t lines = ++g_lines;
  // An error may be the last thing that the process says.
  if (level == LogLevel::kError) wait_for([lines] { return is_done(lines); });
}

void flush_log() {
  if (g_logger == nullptr) return;
  const uint64_t lines = g_lines;
  const absl::Time end = absl::Now() + kFlush;
  absl::Time step_end = absl::Now() + kFlushStep;
  for (uint64_t handled = g_sink->handled(); !is_done(lines) && absl::Now() < std::min(end, step_end);) {
    absl::SleepFor(absl::Milliseconds(1));
    if (g_sink->handled() == handled) continue;
    handled = g_sink->handled();
    step_end = absl::Now() + kFlushStep;
  }
}

uint64_t log_lines_lost() { return g_logger == nullptr ? 0 : overrun() + g_sink->failed(); }

}  // namespace candela
