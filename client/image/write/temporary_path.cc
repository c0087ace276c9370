#include "client/image/write/temporary_path.h"

#include <unistd.h>

#include <atomic>
#include <climits>
#include <cstring>
#include <utility>

namespace candela {
namespace {

// A table, because a signal handler can read neither a string nor a heap that another thread is changing.
struct Slot {
  std::atomic<bool> taken{false};
  std::atomic<bool> filled{false};
  char path[PATH_MAX];
};
constexpr int kSlots = 1024;  // writers at once: one a core
Slot slots[kSlots];

int remember(const std::string& path) {
  for (int i = 0; path.size() < PATH_MAX && i < kSlots; ++i) {
    if (slots[i].taken.exchange(true)) continue;
    std::memcpy(slots[i].path, path.c_str(), path.size() + 1);
    slots[i].filled = true;
    return i;
  }
  return -1;
}

void forget(int slot) {
  if (slot < 0) return;
  slots[slot].filled = false;
  slots[slot].taken = false;
}

}  // namespace

TemporaryPath::TemporaryPath(std::string path) : path_(std::move(path)), slot_(remember(path_)) {}

TemporaryPath::TemporaryPath(TemporaryPath&& other) noexcept
    : path_(std::exchange(other.path_, {})), slot_(std::exchange(other.slot_, -1)) {}

TemporaryPath::~TemporaryPath() {
  if (!path_.empty()) unlink(path_.c_str());
  forget(slot_);
}

void TemporaryPath::let_go() {
  forget(std::exchange(slot_, -1));
  path_.clear();
}

void TemporaryPath::remove_all() {
  for (const Slot& slot : slots) {
    if (slot.filled) unlink(slot.path);
  }
}

}  // namespace candela
