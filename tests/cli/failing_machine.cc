// A library that is preloaded into the command and makes memory, the disk or its timing fail, as the
// environment says.
//   CANDELA_TEST_MAPPINGS=N        N mappings of 4 MB and more succeed, which only pixels take, and no more
//   CANDELA_TEST_FSYNC_FAILS=1     fsync fails
//   CANDELA_TEST_SIGNAL=N          the process gets signal N twice while it makes its first hidden file. Such
//                                  files are made slowly, and raise() is slow, too
//   CANDELA_TEST_FIRST_PROCESS=N   the same, but raise() does nothing, as in process 1 of a container
//   CANDELA_TEST_NO_THREADS=1      once the first hidden file is there, no thread starts
//   CANDELA_TEST_STD_THREADS=N     N threads of std::thread start, and no more; those of gRPC are others
//   CANDELA_TEST_DISK_BYTES=N      the files that fdopen opens can hold N bytes together
#include <dlfcn.h>
#include <fcntl.h>
#include <pthread.h>
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <csignal>
#include <cstdarg>
#include <cstdio>
#include <cstdlib>
#include <cstring>

namespace {

constexpr useconds_t kLate = 300'000;  // us
const char* const first_process = std::getenv("CANDELA_TEST_FIRST_PROCESS");

template <typename Function>
Function* next(const char* name) {
  return reinterpret_cast<Function*>(dlsym(RTLD_NEXT, name));
}

}  // namespace

extern "C" void* mmap(void* at, std::size_t bytes, int protection, int flags, int descriptor, off_t offset) {
  static std::atomic<int> large{0};
  const char* most = std::getenv("CANDELA_TEST_MAPPINGS");
  if (most != nullptr && bytes >= (4u << 20) && large++ >= std::atoi(most)) {
    errno = ENOMEM;
    return MAP_FAILED;
  }
  return next<decltype(mmap)>("mmap")(at, bytes, protection, flags, descriptor, offset);
}

extern "C" int fsync(int) {
  if (std::getenv("CANDELA_TEST_FSYNC_FAILS") == nullptr) return 0;
  errno = EIO;
  return -1;
}

namespace {

std::atomic<bool> wrote_hidden_file = false;

// True for a thread of std::thread: its first function is in the C++ library.
bool is_of_std_thread(void* (*run)(void*)) {
  Dl_info about{};
  return dladdr(reinterpret_cast<void*>(run), &about) != 0 && about.dli_fname != nullptr &&
         std::strstr(about.dli_fname, "libstdc++") != nullptr;
}

bool refuses_thread(void* (*run)(void*)) {
  if (wrote_hidden_file && std::getenv("CANDELA_TEST_NO_THREADS") != nullptr) return true;
  static const char* const most = std::getenv("CANDELA_TEST_STD_THREADS");
  static std::atomic<int> started{0};
  return most != nullptr && is_of_std_thread(run) && started++ >= std::atoi(most);
}

}  // namespace

extern "C" int pthread_create(pthread_t* thread, const pthread_attr_t* attributes, void* (*run)(void*),
                              void* argument) {
  if (refuses_thread(run)) return EAGAIN;
  return next<decltype(pthread_create)>("pthread_create")(thread, attributes, run, argument);
}

extern "C" int open(const char* path, int flags, ...) {
  va_list rest;
  va_start(rest, flags);
  const mode_t mode = (flags & O_CREAT) != 0 ? va_arg(rest, mode_t) : 0;
  va_end(rest);
  const int descriptor = next<int(const char*, int, ...)>("open")(path, flags, mode);
  if (std::strstr(path, ".part") != nullptr) wrote_hidden_file = true;
  static const char* const signal =
      first_process != nullptr ? first_process : std::getenv("CANDELA_TEST_SIGNAL");
  if (signal != nullptr && descriptor >= 0 && std::strstr(path, ".part") != nullptr) {
    static std::atomic<int> files{0};
    const bool first = files++ == 0;
    for (int i = 0; i < 2; ++i) {
      if (first) kill(getpid(), std::atoi(signal));
      usleep(kLate / 2);
    }
  }
  return descriptor;
}

extern "C" int raise(int signal) {
  if (first_process != nullptr) return 0;
  if (std::getenv("CANDELA_TEST_SIGNAL") != nullptr) usleep(kLate / 2);
  return next<int(int)>("raise")(signal);
}

namespace {

std::atomic<ssize_t> disk_left;

// A full disk takes what fits, and the next write fails.
ssize_t write_to_disk(void* descriptor, const char* bytes, size_t count) {
  const auto wanted = static_cast<ssize_t>(count);
  const ssize_t fits = std::min(wanted, disk_left.load());
  disk_left -= fits;
  const ssize_t written = write(*static_cast<int*>(descriptor), bytes, static_cast<size_t>(fits));
  if (fits < wanted) errno = ENOSPC;
  return written < 0 ? 0 : written;
}

int seek_on_disk(void* descriptor, off64_t* position, int whence) {
  *position = lseek64(*static_cast<int*>(descriptor), *position, whence);
  return *position < 0 ? -1 : 0;
}

int close_on_disk(void* descriptor) {
  const int closed = close(*static_cast<int*>(descriptor));
  delete static_cast<int*>(descriptor);
  return closed;
}

}  // namespace

// The C library's own calls of write() cannot be replaced, so its streams are.
extern "C" FILE* fdopen(int descriptor, const char* mode) {
  static const char* const disk_bytes = std::getenv("CANDELA_TEST_DISK_BYTES");
  if (disk_bytes == nullptr) {
    return next<FILE*(int, const char*)>("fdopen")(descriptor, mode);
  }
  static const bool formatted = [] {
    disk_left = std::atoll(disk_bytes);
    return true;
  }();
  (void)formatted;
  return fopencookie(new int(descriptor), mode, {nullptr, write_to_disk, seek_on_disk, close_on_disk});
}
