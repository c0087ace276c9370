#include "client/image/write/standard_output.h"

#include <poll.h>
#include <unistd.h>

#include <cerrno>
#include <vector>

namespace candela {

int write_to_stdout(const void* bytes, size_t count) {
  const char* at = static_cast<const char*>(bytes);
  while (count > 0) {
    const ssize_t written = write(STDOUT_FILENO, at, count);
    if (written < 0 && errno == EAGAIN) {
      pollfd waits{STDOUT_FILENO, POLLOUT, 0};
      poll(&waits, 1, -1);
    } else if (written < 0 && errno != EINTR) {
      return errno;
    } else if (written > 0) {
      at += written;
      count -= static_cast<size_t>(written);
    }
  }
  return 0;
}

int copy_to_stdout(int file) {
  std::vector<char> bytes(1u << 16);
  for (off_t at = 0;;) {
    const ssize_t count = pread(file, bytes.data(), bytes.size(), at);
    if (count < 0 && errno == EINTR) continue;
    if (count <= 0) return count < 0 ? errno : 0;
    at += count;
    if (const int error = write_to_stdout(bytes.data(), static_cast<size_t>(count)); error != 0) return error;
  }
}

}  // namespace candela
