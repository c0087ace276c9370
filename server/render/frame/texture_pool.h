// A pool of the textures of all frames, within a memory budget.
//
// A texture here is a row-linear block of texels in a buffer. On the software device that is far cheaper to
// read and write than an image, and on a device with unified memory the wire pixels are received into the
// buffer itself.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <tuple>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/statusor.h"
#include "absl/synchronization/mutex.h"
#include "server/base/clock.h"
#include "server/vulkan/buffer.h"

namespace candela {

// The kind of a texture: its size in texels, its bytes a texel, and where its memory must lie.
struct TextureKey {
  uint32_t width = 0;
  uint32_t height = 0;
  uint32_t texel_bytes = 0;
  MemoryUse use = MemoryUse::kDevice;

  uint64_t bytes() const;
  auto operator<=>(const TextureKey&) const = default;
};

struct PoolCounters {
  uint64_t hits = 0;
  uint64_t misses = 0;
  uint64_t bytes_in_use = 0;
  uint64_t bytes_idle = 0;
  uint64_t bytes_peak = 0;
};

// Thread-safe. Holds no more than the budget. Idle textures are freed, oldest first, to make room. They are
// also freed when another texture is given back and they have been idle for longer than `keep`. Textures are
// freed outside the lock, so the device may briefly hold both the old and the new ones.
class TexturePool {
 public:
  static constexpr std::chrono::seconds kKeep{30};

  // `device` and `clock` outlive it.
  TexturePool(const Device& device, uint64_t budget_bytes, Clock& clock,
              std::chrono::nanoseconds keep = kKeep);
  ~TexturePool();

  class Lease;

  // UNAVAILABLE if the budget or the device does not hold the texture beside those in use. RESOURCE_EXHAUSTED
  // if the device does not hold it although only the caller's own `own_bytes` are in use. A caller that names
  // less than it holds gets UNAVAILABLE then.
  absl::StatusOr<Lease> take(const TextureKey& key, uint64_t own_bytes = 0);

  // Reserves a part of the budget for memory that is allocated elsewhere: a lease without a texture. Fails as
  // take() does; the error names `what`.
  absl::StatusOr<Lease> reserve(uint64_t bytes, const std::string& what);

  PoolCounters counters() const;
  uint64_t budget_bytes() const { return budget_bytes_; }

 private:
  struct Entry;
  // Frees the oldest idle texture. False if there is none.
  bool give_up_one();
  // Moves the oldest idle texture to `given_up`.
  void give_up_oldest(std::vector<std::unique_ptr<Entry>>* given_up) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  // Counts `bytes` as in use, and moves the idle textures that no longer fit to `given_up`, to be freed
  // outside the lock. `what` is what needs the bytes, for the error message.
  absl::Status make_room(uint64_t bytes, const std::string& what,
                         std::vector<std::unique_ptr<Entry>>* given_up) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void give_back(std::unique_ptr<Entry> entry);

  const Device& device_;
  const uint64_t budget_bytes_;
  Clock& clock_;
  const std::chrono::nanoseconds keep_;
  mutable absl::Mutex mutex_;
  std::vector<std::unique_ptr<Entry>> idle_ ABSL_GUARDED_BY(mutex_);  // oldest first
  PoolCounters counters_ ABSL_GUARDED_BY(mutex_);
};

// A frame's hold on one texture or reservation, which is given back on destruction. Movable.
class TexturePool::Lease {
 public:
  Lease();
  Lease(Lease&&) noexcept;
  Lease& operator=(Lease&&) noexcept;
  ~Lease();

  const Buffer& buffer() const;
  uint64_t bytes() const;  // of the budget; 0 without a hold
  explicit operator bool() const { return entry_ != nullptr; }

 private:
  friend class TexturePool;
  Lease(TexturePool* pool, std::unique_ptr<Entry> entry);
  TexturePool* pool_ = nullptr;
  std::unique_ptr<Entry> entry_;
};

}  // namespace candela
