#include "client/image/write/atomic_file.h"

#include <fcntl.h>
#include <poll.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <climits>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <optional>
#include <utility>
#include <vector>

#include "absl/strings/str_format.h"
#include "client/base/failure.h"
#include "server/base/check.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

enum class State { kFree, kCreating, kOwned };

// A table, because a signal handler can read neither a string nor a heap that another thread is changing.
struct Slot {
  std::atomic<State> state{State::kFree};
  char path[PATH_MAX] = {};  // remove_all() reads it in kOwned only
};
constexpr int kSlots = 1024;   // writers at once: one a core
constinit Slot slots[kSlots];  // zeros: a constructor would touch its 4 MiB in every process

// Set before remove_all() reads the table. A file that is created later would stay.
std::atomic<bool> ending{false};

// A handler may not wait for a lock.
static_assert(std::atomic<State>::is_always_lock_free && std::atomic<bool>::is_always_lock_free);

// Keeps signals from this thread: a handler would wait for the file that the thread it runs in is creating.
class SignalsBlocked {
 public:
  SignalsBlocked() {
    sigset_t all;
    sigfillset(&all);
    pthread_sigmask(SIG_BLOCK, &all, &before_);
  }
  ~SignalsBlocked() { pthread_sigmask(SIG_SETMASK, &before_, nullptr); }
  SignalsBlocked(const SignalsBlocked&) = delete;

 private:
  sigset_t before_;
};

// Returns a slot in kCreating, or -1 if all are in use.
int take_slot() {
  for (int i = 0; i < kSlots; ++i) {
    State expected = State::kFree;
    if (slots[i].state.compare_exchange_strong(expected, State::kCreating)) return i;
  }
  return -1;
}

void free_slot(int slot) { slots[slot].state = State::kFree; }

[[noreturn]] void wait_for_the_end() {
  for (;;) pause();
}

}  // namespace

std::optional<TemporaryPath> TemporaryPath::create(std::string path, mode_t mode, int& descriptor) {
  if (path.size() >= PATH_MAX) {
    errno = ENAMETOOLONG;
    return std::nullopt;
  }
  const SignalsBlocked blocked;
  const int slot = take_slot();
  if (slot < 0) {
    errno = EMFILE;
    return std::nullopt;
  }
  if (ending) {
    free_slot(slot);
    wait_for_the_end();
  }
  std::memcpy(slots[slot].path, path.c_str(), path.size() + 1);
  descriptor = open(path.c_str(), O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, mode);
  if (descriptor < 0) {
    free_slot(slot);
    return std::nullopt;
  }
  slots[slot].state = State::kOwned;
  return TemporaryPath(std::move(path), slot);
}

TemporaryPath::TemporaryPath(std::string path, int slot) : path_(std::move(path)), slot_(slot) {}

TemporaryPath::TemporaryPath(TemporaryPath&& other) noexcept
    : path_(std::exchange(other.path_, {})), slot_(std::exchange(other.slot_, -1)) {}

TemporaryPath::~TemporaryPath() {
  if (slot_ < 0) return;
  unlink(path_.c_str());
  free_slot(slot_);
}

bool TemporaryPath::rename_to(const std::string& target) {
  CHECK(slot_ >= 0 && slots[slot_].state == State::kOwned);
  if (std::rename(path_.c_str(), target.c_str()) != 0) {
    if (ending) wait_for_the_end();  // a failure would be reported as the command's
    return false;
  }
  free_slot(std::exchange(slot_, -1));
  return true;
}

void TemporaryPath::remove_all() {
  ending = true;
  int naps_left = 1000;
  for (const Slot& slot : slots) {
    while (slot.state == State::kCreating && naps_left-- > 0) {
      poll(nullptr, 0, 1);  // sleeps for a millisecond
    }
    if (slot.state == State::kOwned) unlink(slot.path);
  }
}

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
