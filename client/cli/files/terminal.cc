#include "client/cli/files/terminal.h"

#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>

#include "absl/strings/str_format.h"
#include "absl/time/clock.h"
#include "client/base/failure.h"

namespace candela {
namespace {

// A path or a server's message may contain line ends and terminal control codes.
std::string one_line(absl::string_view text) {
  std::string line(text);
  std::replace_if(
      line.begin(), line.end(), [](unsigned char c) { return c < 0x20 || c == 0x7f; }, '?');
  return line;
}

}  // namespace

void print_error(const absl::Status& status) {
  absl::FPrintF(stderr, "candela: error: %s\n", one_line(status.message()));
}

void print_note(const std::string& note) { absl::FPrintF(stderr, "note: %s\n", one_line(note)); }

void print_note_over_progress(const std::string& note) {
  absl::FPrintF(stderr, "%snote: %s\n", isatty(STDERR_FILENO) == 1 ? "\r\033[K" : "", one_line(note));
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

void Progress::show(const std::string& what) { line(one_line(what) + " ..."); }

void Progress::show_bar(double done, const std::string& words) {
  constexpr int kCells = 20;
  constexpr absl::Duration kBetween = absl::Milliseconds(100);
  const absl::Time now = absl::Now();
  if (!shown_ || now - last_bar_ < kBetween) return;
  last_bar_ = now;
  const int full = static_cast<int>(std::clamp(done, 0.0, 1.0) * kCells);
  line(
      absl::StrFormat("[%s%s] %s", std::string(full, '#'), std::string(kCells - full, '.'), one_line(words)));
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

}  // namespace candela
