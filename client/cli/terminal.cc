#include "client/cli/terminal.h"

#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/time/clock.h"
#include "client/base/failure.h"

namespace candela {
namespace {

// The bytes of the UTF-8 character that `text` begins with; 0 if it begins with none that may be printed.
size_t printable_bytes(absl::string_view text) {
  const auto byte = [text](size_t i) { return static_cast<unsigned char>(text[i]); };
  const unsigned char first = byte(0);
  if (first < 0x80) return first >= 0x20 && first != 0x7f ? 1 : 0;
  const size_t bytes = first >= 0xf5 ? 0 : first >= 0xf0 ? 4 : first >= 0xe0 ? 3 : first >= 0xc2 ? 2 : 0;
  if (bytes == 0 || text.size() < bytes) return 0;
  for (size_t i = 1; i < bytes; ++i) {
    if (byte(i) < 0x80 || byte(i) > 0xbf) return 0;
  }
  return first == 0xc2 && byte(1) < 0xa0 ? 0 : bytes;  // terminals take U+0080 .. U+009F as commands
}

}  // namespace

std::string escaped(absl::string_view text) {
  std::string shown;
  while (!text.empty()) {
    const size_t bytes = printable_bytes(text);
    if (bytes > 0) {
      absl::StrAppend(&shown, text.substr(0, bytes));
    } else if (text[0] == '\n' || text[0] == '\r' || text[0] == '\t') {
      absl::StrAppend(&shown, text[0] == '\n' ? "\\n" : text[0] == '\r' ? "\\r" : "\\t");
    } else {
      absl::StrAppendFormat(&shown, "\\x%02x", static_cast<unsigned char>(text[0]));
    }
    text.remove_prefix(std::max<size_t>(1, bytes));
  }
  return shown;
}

void print_error(const absl::Status& status) {
  absl::FPrintF(stderr, "candela: error: %s\n", escaped(status.message()));
}

void print_note(const std::string& note) { absl::FPrintF(stderr, "note: %s\n", escaped(note)); }

void print_note_over_progress(const std::string& note) {
  absl::FPrintF(stderr, "%snote: %s\n", isatty(STDERR_FILENO) == 1 ? "\r\033[K" : "", escaped(note));
}

absl::Status print(const std::string& text) {
  errno = 0;
  if (std::fwrite(text.data(), 1, text.size(), stdout) == text.size() && std::fflush(stdout) == 0) {
    return absl::OkStatus();
  }
  if (errno == EPIPE || errno == EBADF) return absl::OkStatus();
  return failure_of(FailureKind::kOutput, absl::ErrnoToStatus(errno, "cannot write to stdout"));
}

Progress::Progress(bool wanted) : shown_(wanted && isatty(STDERR_FILENO) == 1) {}

void Progress::show(const std::string& what) { line(escaped(what) + " ..."); }

void Progress::show_bar(double done, const std::string& words) {
  constexpr int kCells = 20;
  constexpr absl::Duration kBetween = absl::Milliseconds(100);
  const absl::Time now = absl::Now();
  if (!shown_ || now - last_bar_ < kBetween) return;
  last_bar_ = now;
  const int full = static_cast<int>(std::clamp(done, 0.0, 1.0) * kCells);
  line(absl::StrFormat("[%s%s] %s", std::string(full, '#'), std::string(kCells - full, '.'), escaped(words)));
}

void Progress::line(const std::string& text) {
  if (!shown_) return;
  absl::FPrintF(stderr, "\r\033[K%s", text);
  std::fflush(stderr);
  line_ = true;
}

void Progress::clear() {
  if (!line_) return;
  std::fputs("\r\033[K", stderr);
  std::fflush(stderr);
  line_ = false;
}

namespace {

struct End {
  int code;
  const char* word;
};

End end_of(FailureKind kind) {
  switch (kind) {
    case FailureKind::kUsage:
      return {2, "usage"};
    case FailureKind::kInput:
      return {3, "input"};
    case FailureKind::kServer:
      return {4, "server"};
    case FailureKind::kOutput:
      return {5, "output"};
    case FailureKind::kOther:
      break;
  }
  return {1, "other"};
}

}  // namespace

std::string line_of(const nlohmann::ordered_json& json) {
  return json.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace) + "\n";
}

int exit_code(FailureKind kind) { return end_of(kind).code; }

std::string failure_line(const absl::Status& status) {
  const End end = end_of(kind_of(status));
  const std::string input = input_of(status);
  const nlohmann::ordered_json error = {
      {"code", end.code},
      {"kind", end.word},
      {"message", std::string(status.message())},
      {"input", input.empty() ? nlohmann::ordered_json() : nlohmann::ordered_json(input)}};
  return line_of({{"error", error}});
}

}  // namespace candela
