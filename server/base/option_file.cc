#include "server/base/option_file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdint>
#include <cstring>

#include "absl/cleanup/cleanup.h"
#include "absl/strings/str_format.h"

namespace candela {

absl::StatusOr<std::string> read_option_file(absl::string_view option, const std::string& path,
                                             size_t max_bytes, Secrecy secrecy) {
  // Without O_NONBLOCK, opening a pipe would block.
  const int file = open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
  if (file < 0) {
    return absl::NotFoundError(absl::StrFormat("%s: cannot read %s: %s", option, path, strerror(errno)));
  }
  const absl::Cleanup close_file = [file] { close(file); };
  struct stat about {};
  if (fstat(file, &about) != 0 || !S_ISREG(about.st_mode)) {
    return absl::NotFoundError(absl::StrFormat("%s: %s is not a file", option, path));
  }
  if (secrecy == Secrecy::kSecret && (about.st_mode & (S_IWGRP | S_IROTH | S_IWOTH)) != 0) {
    return absl::FailedPreconditionError(absl::StrFormat(
        "%s: %s holds a secret, but other users may read or change it (mode %03o); run: chmod 600 %s", option,
        path, about.st_mode & 0777, path));
  }
  const auto too_large = [&](int64_t bytes) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: %s has %d bytes; the limit is %d", option, path, bytes, max_bytes));
  };
  if (static_cast<size_t>(about.st_size) > max_bytes) return too_large(about.st_size);
  // Reads to the end, whatever the size: a file of /proc says that it has 0 bytes.
  std::string text(static_cast<size_t>(about.st_size) + 1, '\0');
  size_t filled = 0;
  while (true) {
    const ssize_t count = ::read(file, text.data() + filled, text.size() - filled);
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) {
      return absl::UnavailableError(absl::StrFormat("%s: cannot read %s: %s", option, path, strerror(errno)));
    }
    if (count == 0) break;
    filled += static_cast<size_t>(count);
    if (filled > max_bytes) return too_large(static_cast<int64_t>(filled));
    if (filled == text.size()) text.resize(2 * filled);
  }
  text.resize(filled);
  return text;
}

}  // namespace candela
