#include "server/base/log.h"

#include <spdlog/sinks/stdout_sinks.h>
#include <spdlog/spdlog.h>

#include <memory>
#include <nlohmann/json.hpp>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"

namespace candela {
namespace {

using Json = nlohmann::ordered_json;

// start_logging writes it once. It is never destroyed, because gRPC's threads log until the process ends.
spdlog::logger* g_logger = nullptr;
bool g_json = false;

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

std::string json_line(absl::string_view time, LogLevel level, absl::string_view event,
                      std::initializer_list<LogField> fields) {
  std::string line =
      absl::StrCat("{\"time\":", json_string(time), ",\"level\":", json_string(log_level_word(level)),
                   ",\"event\":", json_string(event));
  for (const LogField& field : fields) {
    absl::StrAppend(&line, ",", json_string(field.key), ":",
                    field.number ? field.value : json_string(field.value));
  }
  return absl::StrCat(line, "}");
}

std::string text_line(absl::string_view time, LogLevel level, absl::string_view event,
                      std::initializer_list<LogField> fields) {
  std::string line = absl::StrCat(time, " ", log_level_word(level), " ", event);
  for (const LogField& field : fields) {
    if (field.value.empty()) continue;
    const std::string json = json_string(field.value);
    const bool plain = !absl::StrContains(field.value, ' ') && json.size() == field.value.size() + 2;
    absl::StrAppend(&line, " ", field.key, "=", plain ? field.value : json);
  }
  return line;
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
  g_logger = new spdlog::logger("candela", std::make_shared<spdlog::sinks::stderr_sink_mt>());
  g_logger->set_level(level_of(options.level));
  g_logger->set_pattern("%v");
  g_logger->flush_on(spdlog::level::debug);
}

void log_event(LogLevel level, absl::string_view event, std::initializer_list<LogField> fields) {
  if (g_logger == nullptr || !g_logger->should_log(level_of(level))) return;
  const std::string time = absl::FormatTime("%Y-%m-%dT%H:%M:%E3SZ", absl::Now(), absl::UTCTimeZone());
  g_logger->log(level_of(level),
                g_json ? json_line(time, level, event, fields) : text_line(time, level, event, fields));
}

}  // namespace candela
