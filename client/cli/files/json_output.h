// The destination of --json.
#pragma once

#include <cstdio>
#include <memory>
#include <optional>
#include <string>

#include "absl/status/statusor.h"
#include "client/image/write/atomic_file.h"

namespace candela {

// Opened before the work starts, so that a path that cannot be written fails early. Used by one thread.
class JsonOutput {
 public:
  // `path` is a file, "-" for stdout, or "" for nowhere. A file appears whole or not at all; its folder is
  // made if it is missing. Pipes and devices are written directly. A path that leads where stdout goes, such
  // as /dev/stdout, is "-". Fails if stdout was closed, and for the file that stderr goes to.
  static absl::StatusOr<JsonOutput> open(const std::string& path);

  bool to_stdout() const { return path_ == "-"; }

  // Appends text. Stdout, pipes and devices get it immediately. close() returns a failure again.
  absl::Status add(const std::string& text);

  // Call it once, after the last add().
  absl::Status close();

  // add() and close().
  absl::Status write(const std::string& text);

 private:
  struct Close {
    void operator()(std::FILE* file) const { std::fclose(file); }
  };
  explicit JsonOutput(std::string path) : path_(std::move(path)) {}

  std::string path_;
  std::optional<AtomicFile> file_;             // empty for stdout, pipes, devices and nowhere
  std::unique_ptr<std::FILE, Close> special_;  // a pipe or device, opened by the first add()
  absl::Status status_;
};

}  // namespace candela
