// Where --json writes.
#pragma once

#include <cstdio>
#include <memory>
#include <optional>
#include <string>

#include "absl/status/statusor.h"
#include "client/image/write/atomic_file.h"

namespace candela {

// Opened before the work, so that a path that cannot be written is known before it. Used by one thread.
class JsonOutput {
 public:
  // A path, "-" for stdout, "" for nowhere. A file appears whole or not at all; pipes and devices are written
  // to as they are.
  static absl::StatusOr<JsonOutput> open(const std::string& path);

  bool to_stdout() const { return path_ == "-"; }

  // Adds text, which stdout, pipes and devices get at once. A failure also comes back from close().
  absl::Status add(const std::string& text);

  // Once, after everything was added.
  absl::Status close();

  // All there is to say, at once: add() and close().
  absl::Status write(const std::string& text);

 private:
  struct Close {
    void operator()(std::FILE* file) const { std::fclose(file); }
  };
  explicit JsonOutput(std::string path) : path_(std::move(path)) {}

  std::string path_;
  std::optional<AtomicFile> file_;             // absent: stdout, a pipe or device, or nowhere
  std::unique_ptr<std::FILE, Close> special_;  // a pipe or device, once something was added
  absl::Status status_;
};

}  // namespace candela
