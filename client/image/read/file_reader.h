// Reads a regular file, or bytes in memory, from front to back, buffered.
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
  // Fails with NOT_FOUND, PERMISSION_DENIED or INVALID_ARGUMENT (for a folder or a pipe); the message names
  // the path.
  static absl::StatusOr<FileReader> open(const std::string& path);

  // Reads `bytes` as the file `name`, which messages name.
  static absl::StatusOr<FileReader> of(std::string name, std::string bytes);

  const std::string& path() const { return path_; }
  uint64_t size() const { return size_; }
  uint64_t position() const { return position_; }
  uint64_t remaining() const { return size_ - position_; }

  // Returns the next `count` bytes, at most 256, without taking them; fewer at the end of the file. Fails if
  // they cannot be read, with a message that names the path.
  absl::StatusOr<std::string> peek(size_t count);

  // Takes the next byte. Returns -1 at the end.
  int get();

  // Fills `out`. False if the file ends or reading fails before it is full.
  bool read(std::span<std::byte> out);

  // Skips bytes. False if the file has fewer.
  bool skip(uint64_t count);

  // Goes to a position in the file. False if the file is shorter.
  bool seek(uint64_t position);

  // Takes the next line without its newline. False if there is no newline within `max_length` bytes.
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
  std::unique_ptr<std::string> bytes_;  // null for a regular file
  std::unique_ptr<std::FILE, Close> file_;
  uint64_t size_ = 0;
  uint64_t position_ = 0;
};

}  // namespace candela
