#include "server/base/pixel_memory.h"

#include <sys/mman.h>

#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <limits>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"

namespace candela {
namespace {

constexpr size_t kLargePage = size_t{2} << 20;  // of x86-64, and of arm64 with pages of 4 KiB

std::byte* first_large_page(void* mapping) {
  const auto begin = reinterpret_cast<uintptr_t>(mapping);
  return reinterpret_cast<std::byte*>((begin + kLargePage - 1) / kLargePage * kLargePage);
}

// All mappings of this process.
class Mappings {
 public:
  Mappings() { idle_.reserve(kMostIdle); }

  // At least `bytes`, which becomes their number. Null if there is no memory.
  void* take(size_t& bytes, bool zeros) {
    const absl::MutexLock lock(&mutex_);
    void* mapping = zeros ? nullptr : take_idle(bytes);
    if (mapping == nullptr) mapping = map(bytes);
    if (mapping == nullptr) return nullptr;
    in_use_ += bytes;
    most_in_use_ = std::max(most_in_use_, in_use_);
    drop_excess();
    return mapping;
  }

  void give_back(void* mapping, size_t bytes) {
    const absl::MutexLock lock(&mutex_);
    in_use_ -= bytes;
    if (idle_.size() == kMostIdle) drop_oldest();
    idle_bytes_ += bytes;
    idle_.push_back({mapping, bytes});
    drop_excess();
    if (!idle_.empty()) madvise(mapping, bytes, MADV_FREE);
  }

  size_t idle_bytes() {
    const absl::MutexLock lock(&mutex_);
    return idle_bytes_;
  }

 private:
  static constexpr size_t kMostIdle = 64;  // mappings
  static constexpr size_t kMostTimes = 3;  // as large as asked for: a result has half of its frame or less

  struct Idle {
    void* mapping;
    size_t bytes;
  };

  // The smallest of at least `bytes` that is not far larger; of those the one that was used last. Sets
  // `bytes` to its size. Null if there is none.
  void* take_idle(size_t& bytes) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    auto best = idle_.end();
    for (auto i = idle_.begin(); i != idle_.end(); ++i) {
      if (i->bytes >= bytes && i->bytes / kMostTimes <= bytes &&
          (best == idle_.end() || i->bytes <= best->bytes))
        best = i;
    }
    if (best == idle_.end()) return nullptr;
    void* const mapping = best->mapping;
    bytes = best->bytes;
    idle_bytes_ -= bytes;
    idle_.erase(best);
    return mapping;
  }

  void* map(size_t bytes) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    while (true) {
      void* const mapping = mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
      if (mapping != MAP_FAILED) {
        madvise(mapping, bytes, MADV_HUGEPAGE);  // a system that has none declines
        return mapping;
      }
      if (idle_.empty()) return nullptr;
      drop_oldest();
    }
  }

  void drop_excess() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    while (!idle_.empty() && (idle_bytes_ > kMostIdlePixels || in_use_ + idle_bytes_ > most_in_use_))
      drop_oldest();
  }

  void drop_oldest() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    munmap(idle_.front().mapping, idle_.front().bytes);
    idle_bytes_ -= idle_.front().bytes;
    idle_.erase(idle_.begin());
  }

  absl::Mutex mutex_;
  size_t in_use_ ABSL_GUARDED_BY(mutex_) = 0;
  size_t most_in_use_ ABSL_GUARDED_BY(mutex_) = 0;
  size_t idle_bytes_ ABSL_GUARDED_BY(mutex_) = 0;
  std::vector<Idle> idle_ ABSL_GUARDED_BY(mutex_);  // oldest first
};

// Never destroyed, because other static objects may hold pixels.
Mappings& mappings() {
  static auto* const kMappings = new Mappings;
  return *kMappings;
}

PixelMemory take(size_t bytes, bool zeros) {
  if (bytes < kLargePage / 2) return PixelMemory(static_cast<std::byte*>(std::calloc(bytes, 1)));
  if (bytes > std::numeric_limits<size_t>::max() / 2) return nullptr;
  // One more, because the system may begin anywhere.
  size_t mapped = (bytes - 1) / kLargePage * kLargePage + 2 * kLargePage;
  void* const mapping = mappings().take(mapped, zeros);
  if (mapping == nullptr) return nullptr;
  return PixelMemory(first_large_page(mapping), {mapping, mapped, nullptr});
}

}  // namespace

void FreePixels::operator()(std::byte* pixels) const {
  if (owner != nullptr) {
    owner.reset();
  } else if (mapping == nullptr) {
    std::free(pixels);
  } else {
    mappings().give_back(mapping, mapped_bytes);
  }
}

PixelMemory new_pixels(size_t bytes) { return take(bytes, true); }

PixelMemory pixels_to_overwrite(size_t bytes) { return take(bytes, false); }

size_t idle_pixels() { return mappings().idle_bytes(); }

}  // namespace candela
