// What a failure is about, so that a program can tell a damaged file from a full disk and from a lost server.
#pragma once

#include <exception>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/string_view.h"

namespace candela {

// A status carries its kind from where the error is made to the end of the command, which turns it into an
// exit code (client/cli/terminal.h).
enum class FailureKind {
  kOther,   // this machine lacks memory, threads or a program; or several failures of several kinds
  kUsage,   // the command line is wrong
  kInput,   // a file that is read: missing, damaged, refused
  kServer,  // a server or a device: not there, lost, refuses the client
  kOutput,  // a file or a stream that is written
};

// The status with this kind. OK stays OK. A status that has a kind keeps it, because the kind was set nearer
// to the cause.
absl::Status failure_of(FailureKind kind, absl::Status status);

// kOther if none was set.
FailureKind kind_of(const absl::Status& status);

// The status with the input file that failed, unless it has one already or `path` is "".
absl::Status about_input(absl::Status status, const std::string& path);

// A failure of the kind kInput that is about this file: failure_of() and about_input() together.
absl::Status input_failure(const absl::Status& status, const std::string& path);

// The input file that the failure is about; "" if it is about none.
std::string input_of(const absl::Status& status);

// The same failure in other words.
absl::Status reworded(const absl::Status& status, absl::string_view words);

// The kind of several failures, one after the other: their common kind, or kOther.
void add_failure(std::optional<FailureKind>& all, const absl::Status& one);

// Errors for memory and threads that this process could not get.

// RESOURCE_EXHAUSTED, with what the user can do, if it is about memory or a thread.
// INTERNAL with the exception's words for any other.
absl::Status system_failure(const std::exception& error);

// Usage errors: mistakes in the command line itself. They have an exit code of their own.

// An INVALID_ARGUMENT of the kind kUsage, for a wrong use of the command. One line.
absl::Status usage_error(const std::string& message);
bool is_usage_error(const absl::Status& status);

// `--json is empty; leave it out or give it a value`. `option` is "--json".
absl::Status empty_value(const std::string& option);

// `unknown curve "aces-hil"; did you mean aces-hill? There are: linear, aces-hill`. `what` is "curve".
absl::Status unknown_word(const std::string& what, const std::string& typed,
                          const std::vector<std::string>& words);

}  // namespace candela
