// The terminal: progress, notes, and the line that a failure becomes.
#pragma once

#include <nlohmann/json.hpp>
#include <string>

#include "absl/status/status.h"
#include "absl/strings/string_view.h"
#include "absl/time/time.h"
#include "client/base/failure.h"

namespace candela {

// Output for the user: errors, notes and progress on stderr, and text on stdout.

// Text for a terminal: line ends and control characters, which a path or a server's message may contain, and
// bytes that are no UTF-8 become escapes such as \n and \x1b.
std::string escaped(absl::string_view text);

// Prints `candela: error: ...` on stderr, always as a single line.
void print_error(const absl::Status& status);

// Prints `note: ...` on stderr, as a single line.
void print_note(const std::string& note);

// The same while a Progress may show its line. Any thread.
void print_note_over_progress(const std::string& note);

// Prints to stdout. Fails if stdout cannot be written, for example on a full disk. A closed pipe is not an
// error, and neither is a stdout that was closed from the start: nobody wants to read it.
absl::Status print(const std::string& text);

// A line on stderr that shows the current work and disappears afterwards. Used by one thread.
class Progress {
 public:
  // Shows nothing if stderr is not a terminal.
  explicit Progress(bool wanted);
  ~Progress() { clear(); }
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  void show(const std::string& what);
  // Shows a bar, filled to `done` (0 .. 1), and words after it. Ignores calls beyond ten per second.
  void show_bar(double done, const std::string& words);
  void clear();  // call it before printing anything else

 private:
  const bool shown_;
  void line(const std::string& text);

  bool line_ = false;  // true if there is a line to clear
  absl::Time last_bar_ = absl::InfinitePast();
};

// Lines of JSON, and how a failed command ends: its exit code, and its failure as such a line.
// docs/failures.md is for users.

// A value as one line of JSON, with a line end. Invalid UTF-8, which a path may have, is replaced.
std::string line_of(const nlohmann::ordered_json& json);

// 2 usage, 3 input, 4 server, 5 output, 1 other.
int exit_code(FailureKind kind);

// {"error": {"code": 3, "kind": "input", "message": "...", "input": "in.exr"}} as one line, with a line end.
// `code` is the exit code; `input` is null if the failure is about none.
std::string failure_line(const absl::Status& status);

}  // namespace candela
