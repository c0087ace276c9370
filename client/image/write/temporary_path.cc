#include "client/image/write/temporary_path.h"

#include <fcntl.h>
#include <poll.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <climits>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <utility>

#include "server/base/check.h"

namespace candela {
namespace {

enum class State { kFree, kCreating, kOwned };

// A table, because a signal handler can read neither a string nor a heap that another thread is changing.
struct Slot {
  std::atomic<State> state{State::kFree};
  char path[PATH_MAX] = {};  // remove_all() reads it in kOwned only
};
constexpr int kSlots = 1024;  // writers at once: one a core
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

}  // namespace candela
