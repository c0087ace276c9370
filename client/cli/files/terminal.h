// What the user sees: one line for an error, notes, progress on a terminal, and stdout.
#pragma once

#include <string>

#include "absl/status/status.h"
#include "absl/time/time.h"

namespace candela {

// `candela: error: ...` on stderr, in one line whatever the message holds.
void print_error(const absl::Status& status);

// `note: ...` on stderr.
void print_note(const std::string& note);

// Fails when stdout takes it not, as on a full disk. A reader that has gone away has heard enough: OK.
absl::Status print(const std::string& text);

// One line on stderr that says what is being done, gone when it is done. Used by one thread.
class Progress {
 public:
  // Shows nothing when stderr is not a terminal.
  explicit Progress(bool wanted);
  ~Progress() { clear(); }
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  void show(const std::string& what);
  // A bar that is `done` (0 .. 1) full, and words behind it. At most ten times a second; else it does
  // nothing.
  void show_bar(double done, const std::string& words);
  void clear();  // before anything else is printed

 private:
  const bool shown_;
  void line(const std::string& text);

  bool line_ = false;  // there is one to clear
  absl::Time last_bar_ = absl::InfinitePast();
};

}  // namespace candela
