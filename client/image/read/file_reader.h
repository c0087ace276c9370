// Buffered reading of a regular file, front to back.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <memory>
#include <span>
#include <string>
#include <utility>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

namespace candela {

// Used by one thread.
class FileReader {
 public:
  // NOT_FOUND, PERMISSION_DENIED or INVALID_ARGUMENT (a folder, a pipe), naming the path.
  static absl::StatusOr<FileReader> open(const std::string& path);

  const std::string& path() const { return path_; }
  uint64_t remaining() const { return size_ - position_; }

  // The next bytes, fewer at the end of the file, without taking them; at most 64.
  std::string peek(size_t count);

  // The next byte, or -1 at the end.
  int get();

  // Fills `out`; false when the file ends (or stops being readable) before it is full.
  bool read(std::span<std::byte> out);

  // Passes over bytes; false when the file has fewer.
  bool skip(uint64_t count);

  // Takes the next line without its newline; false when it ends or passes `max_length` before one.
  bool read_line(std::string& line, size_t max_length);

  // INVALID_ARGUMENT, "PATH: the file is truncated: <what> is missing".
  absl::Status truncated(const std::string& what) const;

 private:
  struct Close {
    void operator()(std::FILE* file) const { std::fclose(file); }
  };
  FileReader(std::string path, std::FILE* file, uint64_t size)
      : path_(std::move(path)), file_(file), size_(size) {}

  std::string path_;
  std::unique_ptr<std::FILE, Close> file_;
  uint64_t size_ = 0;
  uint64_t position_ = 0;
};

}  // namespace candela
