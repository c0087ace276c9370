// Reads a descriptor that may be a pipe, buffered. Internal to client/image.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/status.h"

namespace candela {

// Used by one thread, but for stop().
class ByteSource {
 public:
  explicit ByteSource(int descriptor);
  ~ByteSource();
  ByteSource(const ByteSource&) = delete;
  ByteSource& operator=(const ByteSource&) = delete;

  // Takes the next byte. Returns -1 at the end.
  int get();

  // Appends the next `count` bytes. False if there are fewer; then it appends these. It takes memory as the
  // bytes come.
  bool take(uint64_t count, std::string& bytes);

  // Ends the stream, also for a get() or take() that waits. Any thread.
  void stop();

  // Why the stream cannot be read. OK at its end, and after stop().
  absl::Status status() const;

 private:
  // Reads what is there, at least a byte. Returns the number of bytes, 0 at the end.
  size_t read_some(char* to, size_t most);

  const int descriptor_;
  const int stopped_;  // an eventfd, or -1 if the system gave none
  std::vector<char> buffer_;
  size_t at_ = 0, end_ = 0;  // in the buffer
  int error_ = 0;            // an errno
  bool ended_ = false;
};

}  // namespace candela
