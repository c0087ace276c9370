// Logs: one line an event, for people or as JSON. Nothing is written before start_logging, so a program that
// embeds a server stays quiet. Any thread.
#pragma once

#include <initializer_list>
#include <string>

#include "absl/strings/string_view.h"

namespace candela {

enum class LogLevel { kDebug, kInfo, kWarning, kError, kOff };

struct LogOptions {
  LogLevel level = LogLevel::kInfo;
  bool json = false;  // one JSON object a line
};

// Events go to stderr from now on. Call once, before other threads log.
void start_logging(const LogOptions& options);

// A value beside an event. Never a path or a token of a client's.
struct LogField {
  LogField(absl::string_view k, absl::string_view v) : key(k), value(v) {}
  LogField(absl::string_view k, const char* v) : key(k), value(v) {}
  LogField(absl::string_view k, const std::string& v) : key(k), value(v) {}
  LogField(absl::string_view k, double v);
  LogField(absl::string_view k, int64_t v);
  LogField(absl::string_view k, uint64_t v);

  absl::string_view key;
  std::string value;
  bool number = false;
};

// `event` is a constant: what happened, in words that can be searched for.
void log_event(LogLevel level, absl::string_view event, std::initializer_list<LogField> fields = {});

}  // namespace candela
