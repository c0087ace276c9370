#include "client/image/write/atomic_file.h"

#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstdlib>
#include <filesystem>
#include <optional>

#include "absl/strings/str_format.h"
#include "client/base/failure.h"
#include "client/image/write/standard_output.h"
#include "server/base/check.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

std::atomic<unsigned> counter{0};

const char* kind_name(mode_t mode) {
  return S_ISFIFO(mode) ? "a FIFO" : S_ISSOCK(mode) ? "a socket" : "a device";
}

}  // namespace

absl::Status cannot_write(const std::string& path, int error) {
  return failure_of(FailureKind::kOutput,
                    absl::ErrnoToStatus(error, absl::StrFormat("%s: cannot write", path)));
}

absl::StatusOr<std::string> writable_destination(const std::string& path) {
  std::string target = path;
  struct stat info {};
  if (lstat(path.c_str(), &info) == 0 && S_ISLNK(info.st_mode)) {
    const std::unique_ptr<char, decltype(&std::free)> end(realpath(path.c_str(), nullptr), &std::free);
    if (end == nullptr) return cannot_write(path, errno);
    target = end.get();
  }
  if (stat(target.c_str(), &info) == 0) {
    if (S_ISDIR(info.st_mode)) return cannot_write(path, EISDIR);
    if (!S_ISREG(info.st_mode)) {
      return failure_of(FailureKind::kOutput, absl::FailedPreconditionError(absl::StrFormat(
                                                  "%s: cannot write: this is %s; name a plain file", path,
                                                  kind_name(info.st_mode))));
    }
    // Checked because rename() would replace even a file without write permission.
    if (access(target.c_str(), W_OK) != 0) return cannot_write(path, errno);
  }
  const std::string folder = std::filesystem::path(target).parent_path().string();
  if (access(folder.empty() ? "." : folder.c_str(), W_OK | X_OK) != 0) return cannot_write(path, errno);
  return target;
}

absl::StatusOr<AtomicFile> AtomicFile::create(const std::string& path) {
  ASSIGN_OR_RETURN(std::string target, writable_destination(path));
  struct stat old {};
  const bool replaces = stat(target.c_str(), &old) == 0;
  // The permissions are never wider than the old file's. A new file is created with the usual mode, so that
  // the umask applies.
  const mode_t mode = replaces ? old.st_mode & 0777 : 0666;
  const size_t slash = target.rfind('/') + 1;
  for (int attempts = 0; attempts < 100; ++attempts) {
    const std::string name = absl::StrFormat("%s.%s.%d-%d.part", target.substr(0, slash),
                                             target.substr(slash, 200), getpid(), counter++);
    int descriptor = -1;
    std::optional<TemporaryPath> temporary = TemporaryPath::create(name, mode, descriptor);
    if (!temporary && errno == EEXIST) continue;
    if (!temporary) return cannot_write(path, errno);
    std::FILE* file = replaces && fchmod(descriptor, mode) != 0 ? nullptr : fdopen(descriptor, "wb");
    if (file == nullptr) {
      const int error = errno;
      close(descriptor);
      return cannot_write(path, error);
    }
    setvbuf(file, nullptr, _IOFBF, 1 << 16);
    return AtomicFile(path, std::move(target), *std::move(temporary), file);
  }
  return cannot_write(path, EEXIST);
}

absl::StatusOr<AtomicFile> AtomicFile::for_stdout() {
  const int descriptor = memfd_create("candela", MFD_CLOEXEC);
  std::FILE* file = descriptor < 0 ? nullptr : fdopen(descriptor, "w+b");
  if (file == nullptr) {
    const int error = errno;
    if (descriptor >= 0) close(descriptor);
    return cannot_write(kStdoutName, error);
  }
  return AtomicFile(kStdoutName, "", std::nullopt, file);
}

bool AtomicFile::write(const void* bytes, size_t count) {
  CHECK(file_ != nullptr);  // not after commit()
  if (error_ == 0 && std::fwrite(bytes, 1, count, file_.get()) != count) error_ = errno;
  return error_ == 0;
}

bool AtomicFile::seek(uint64_t position) {
  CHECK(file_ != nullptr);
  if (error_ == 0 && std::fseek(file_.get(), static_cast<long>(position), SEEK_SET) != 0) error_ = errno;
  return error_ == 0;
}

absl::Status AtomicFile::commit() {
  CHECK(file_ != nullptr);
  if (error_ == 0 && std::fflush(file_.get()) != 0) error_ = errno;
  if (!temporary_) {
    if (error_ == 0) error_ = copy_to_stdout(fileno(file_.get()));
    file_.reset();
    // Nobody wants to read it.
    return error_ == 0 || error_ == EPIPE ? absl::OkStatus() : cannot_write(path_, error_);
  }
  // EINVAL: the file is not on a disk.
  if (error_ == 0 && fsync(fileno(file_.get())) != 0 && errno != EINVAL) error_ = errno;
  if (std::fclose(file_.release()) != 0 && error_ == 0) error_ = errno;
  if (error_ != 0) return cannot_write(path_, error_);
  if (!temporary_->rename_to(target_)) return cannot_write(path_, errno);
  return absl::OkStatus();
}

}  // namespace candela
