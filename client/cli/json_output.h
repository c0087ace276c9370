// Where --json writes.
#pragma once

#include <optional>
#include <string>

#include "absl/status/statusor.h"
#include "client/image/atomic_file.h"

namespace candela {

// Opened before the work, so that a path that cannot be written is known before it. Used by one thread.
class JsonOutput {
 public:
  // A path, "-" for stdout, "" for nowhere. A file appears whole or not at all; pipes and devices are written
  // to as they are.
  static absl::StatusOr<JsonOutput> open(const std::string& path);

  bool to_stdout() const { return path_ == "-"; }

  // Once.
  absl::Status write(const std::string& text);

 private:
  explicit JsonOutput(std::string path) : path_(std::move(path)) {}

  std::string path_;
  std::optional<AtomicFile> file_;  // absent: stdout, a pipe or device, or nowhere
};

}  // namespace candela
