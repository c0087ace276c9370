// The log: one line per event, as text or as JSON. Nothing is written before start_logging, so a program that
// embeds a server stays quiet. Any thread.
//
// A regular file is written at once. A pipe, a socket or a terminal may have a reader that sleeps,
// so a thread of the log writes to it, in order, behind a bounded queue. If the queue is full for a tenth of
// a second, its oldest line is lost: the service does not wait for its log. The next line that can be written
// says how many were lost.
#pragma once

#include <initializer_list>
#include <string>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

namespace candela {

enum class LogLevel { kDebug, kInfo, kWarning, kError, kOff };

const char* log_level_word(LogLevel level);
// INVALID_ARGUMENT, listing the words, for anything else.
absl::StatusOr<LogLevel> parse_log_level(absl::string_view word);

struct LogOptions {
  LogLevel level = LogLevel::kInfo;
  bool json = false;  // one JSON object per line
};

// Starts writing events to stderr. Call it once, before other threads log.
void start_logging(const LogOptions& options);

// Returns when every line so far is written, or when the reader has taken none for a quarter of a second.
// Call it before the process ends.
void flush_log();

// The number of lines that nobody read and that were given up, or that could not be written.
uint64_t log_lines_lost();

// A value that belongs to an event. Never log a client's path or token.
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

// `event` says what happened. It is a constant, so that it can be searched for.
void log_event(LogLevel level, absl::string_view event, std::initializer_list<LogField> fields = {});

}  // namespace candela
