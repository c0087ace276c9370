#include "client/image/atomic_file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>

#include "absl/strings/str_format.h"

namespace candela {
namespace {

std::atomic<unsigned> counter{0};

}  // namespace

absl::Status cannot_write(const std::string& path, int error) {
  return absl::ErrnoToStatus(error, absl::StrFormat("%s: cannot write", path));
}

absl::StatusOr<AtomicFile> AtomicFile::create(const std::string& path) {
  // rename() would replace a file that its owner has closed to writing.
  if (access(path.c_str(), F_OK) == 0 && access(path.c_str(), W_OK) != 0) return cannot_write(path, errno);
  const size_t slash = path.rfind('/') + 1;
  for (int attempts = 0; attempts < 100; ++attempts) {
    const std::string name = absl::StrFormat("%s.%s.%d-%d.part", path.substr(0, slash),
                                             path.substr(slash, 200), getpid(), counter++);
    // As a plain file would be made, so that the umask decides who may read it.
    const int descriptor = open(name.c_str(), O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
    if (descriptor < 0 && errno == EEXIST) continue;
    if (descriptor < 0) return cannot_write(path, errno);
    TemporaryPath temporary(name);
    std::FILE* file = fdopen(descriptor, "wb");
    if (file == nullptr) {
      const int error = errno;
      close(descriptor);
      return cannot_write(path, error);
    }
    setvbuf(file, nullptr, _IOFBF, 1 << 16);
    return AtomicFile(path, std::move(temporary), file);
  }
  return cannot_write(path, EEXIST);
}

bool AtomicFile::write(const void* bytes, size_t count) {
  if (error_ == 0 && std::fwrite(bytes, 1, count, file_.get()) != count) error_ = errno;
  return error_ == 0;
}

bool AtomicFile::seek(uint64_t position) {
  if (error_ == 0 && std::fseek(file_.get(), static_cast<long>(position), SEEK_SET) != 0) error_ = errno;
  return error_ == 0;
}

absl::Status AtomicFile::commit() {
  if (error_ == 0 && std::fflush(file_.get()) != 0) error_ = errno;
  if (std::fclose(file_.release()) != 0 && error_ == 0) error_ = errno;
  if (error_ != 0) return cannot_write(path_, error_);
  if (std::rename(temporary_.path().c_str(), path_.c_str()) != 0) return cannot_write(path_, errno);
  temporary_.let_go();
  return absl::OkStatus();
}

}  // namespace candela
