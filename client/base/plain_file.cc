#include "client/base/plain_file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

#include "absl/cleanup/cleanup.h"
#include "absl/strings/str_format.h"

namespace candela {

absl::StatusOr<std::string> read_plain_file(const std::string& path, size_t max_bytes) {
  // Without O_NONBLOCK, opening a pipe would wait for its writer.
  const int file = open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
  if (file < 0) return absl::NotFoundError(std::strerror(errno));
  const absl::Cleanup close_file = [file] { close(file); };
  struct stat about {};
  if (fstat(file, &about) != 0 || !S_ISREG(about.st_mode)) {
    return absl::NotFoundError("it is not a regular file");
  }
  if (static_cast<size_t>(about.st_size) > max_bytes) {
    return absl::InvalidArgumentError(
        absl::StrFormat("it has %d bytes and the limit is %d", about.st_size, max_bytes));
  }
  std::string text(static_cast<size_t>(about.st_size), '\0');
  size_t filled = 0;
  while (filled < text.size()) {
    const ssize_t count = read(file, text.data() + filled, text.size() - filled);
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) return absl::NotFoundError(std::strerror(errno));
    if (count == 0) break;
    filled += static_cast<size_t>(count);
  }
  text.resize(filled);
  return text;
}

}  // namespace candela
