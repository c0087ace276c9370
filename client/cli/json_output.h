// The destination of --json.
#pragma once

#include <cstdio>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "client/image/write/atomic_file.h"

namespace candela {

// Used by one thread.
class JsonOutput {
 public:
  // `path` is a file, "-" for stdout, or "" for nowhere. A file appears whole or not at all; its folder is
  // made if it is missing. Pipes and devices are written directly. A path that leads where stdout goes, such
  // as /dev/stdout, is "-".
  explicit JsonOutput(std::string path) : path_(std::move(path)) {}

  // Call it before the work, so that a path that cannot be written fails early, and after
  // check_outputs_apart(). Fails if stdout was closed, and for the file that stderr goes to.
  absl::Status open();

  bool to_stdout() const { return path_ == "-"; }

  // Appends text. Stdout, pipes and devices get it immediately. close() returns a failure again.
  absl::Status add(const std::string& text);

  // Call it once, after the last add().
  absl::Status close();

  // add() and close().
  absl::Status write(const std::string& text);

  // The command failed: adds its failure as the last line (see terminal.h) and closes. Does nothing after
  // close(). Before open(), a regular file is replaced only if it is JSON, or empty, and if none of `words`,
  // the command line, names it: nobody has checked that it is no input.
  void fail(const absl::Status& failure, const std::vector<std::string>& words);

 private:
  struct Close {
    void operator()(std::FILE* file) const { std::fclose(file); }
  };
  absl::Status open_path();

  std::string path_;
  bool open_ = false;
  bool closed_ = false;
  std::optional<AtomicFile> file_;             // empty for stdout, pipes, devices and nowhere
  std::unique_ptr<std::FILE, Close> special_;  // a pipe or device, opened by the first add()
  absl::Status status_;
};

// Refuses images for stdout if the JSON goes there, too, or if it is a terminal. Call it after json.open().
absl::Status check_stdout(const JsonOutput& json);

}  // namespace candela
