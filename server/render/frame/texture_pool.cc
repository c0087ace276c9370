#include "server/render/frame/texture_pool.h"

#include <algorithm>
#include <chrono>
#include <utility>

#include "absl/strings/str_format.h"
#include "server/base/check.h"
#include "server/base/status_macros.h"

namespace candela {

struct TexturePool::Entry {
  TextureKey key;
  uint64_t bytes = 0;
  Buffer buffer;  // empty for a reservation
  std::chrono::steady_clock::time_point idle_since{};
};

uint64_t TextureKey::bytes() const {
  // A texel buffer holds whole texels of 16 bytes.
  return std::max<uint64_t>(16, uint64_t{width} * height * texel_bytes);
}

TexturePool::TexturePool(const Device& device, uint64_t budget_bytes, Clock& clock,
                         std::chrono::nanoseconds keep)
    : device_(device), budget_bytes_(budget_bytes), clock_(clock), keep_(keep) {}

TexturePool::~TexturePool() {
  const absl::MutexLock lock(&mutex_);
  CHECK(counters_.bytes_in_use == 0);
  for (const auto& entry : idle_) counters_.bytes_idle -= entry->bytes;
  CHECK(counters_.bytes_idle == 0);
}

absl::StatusOr<TexturePool::Lease> TexturePool::take(const TextureKey& key, uint64_t own_bytes) {
  const uint64_t bytes = key.bytes();
  std::vector<std::unique_ptr<Entry>> given_up;  // freed outside the lock, because a driver may take long
  {
    const absl::MutexLock lock(&mutex_);
    // The most recent first: its pages are most likely to be warm.
    const auto found =
        std::find_if(idle_.rbegin(), idle_.rend(), [&](const auto& e) { return e->key == key; });
    if (found != idle_.rend()) {
      std::unique_ptr<Entry> entry = std::move(*found);
      idle_.erase(std::next(found).base());
      ++counters_.hits;
      CHECK(counters_.bytes_idle >= bytes);
      counters_.bytes_idle -= bytes;
      counters_.bytes_in_use += bytes;
      return Lease(this, std::move(entry));
    }
    const std::string what = absl::StrFormat("a %dx%d texture", key.width, key.height);
    RETURN_IF_ERROR(make_room(bytes, what, &given_up));
    ++counters_.misses;
  }
  given_up.clear();
  absl::StatusOr<Buffer> buffer = Buffer::create(device_, bytes, key.use);
  // The device may have less memory than the budget. Idle textures are of use only while there is room.
  while (absl::IsResourceExhausted(buffer.status()) && give_up_one()) {
    buffer = Buffer::create(device_, bytes, key.use);
  }
  if (!buffer.ok()) {
    const absl::MutexLock lock(&mutex_);
    CHECK(counters_.bytes_in_use >= bytes);
    counters_.bytes_in_use -= bytes;
    if (!absl::IsResourceExhausted(buffer.status()) || counters_.bytes_in_use <= own_bytes) {
      return buffer.status();
    }
    return absl::UnavailableError(absl::StrFormat(
        "the device has no memory for a %dx%d texture of %d bytes beside those in use; try again when frames "
        "in flight are done, or lower --memory-budget",
        key.width, key.height, bytes));
  }
  return Lease(this, std::make_unique<Entry>(key, bytes, *std::move(buffer)));
}

absl::StatusOr<TexturePool::Lease> TexturePool::reserve(uint64_t bytes, const std::string& what) {
  std::vector<std::unique_ptr<Entry>> given_up;  // freed outside the lock
  const absl::MutexLock lock(&mutex_);
  RETURN_IF_ERROR(make_room(bytes, what, &given_up));
  return Lease(this, std::make_unique<Entry>(TextureKey{}, bytes, Buffer()));
}

absl::Status TexturePool::make_room(uint64_t bytes, const std::string& what,
                                    std::vector<std::unique_ptr<Entry>>* given_up) {
  if (counters_.bytes_in_use + bytes > budget_bytes_) {
    return absl::UnavailableError(absl::StrFormat(
        "%s needs %d bytes, and frames in flight hold %d of the memory budget of %d; try again when they are "
        "done, or raise --memory-budget",
        what, bytes, counters_.bytes_in_use, budget_bytes_));
  }
  while (!idle_.empty() && counters_.bytes_in_use + counters_.bytes_idle + bytes > budget_bytes_) {
    give_up_oldest(given_up);
  }
  counters_.bytes_in_use += bytes;
  CHECK(counters_.bytes_in_use + counters_.bytes_idle <= budget_bytes_);
  counters_.bytes_peak = std::max(counters_.bytes_peak, counters_.bytes_in_use + counters_.bytes_idle);
  return absl::OkStatus();
}

bool TexturePool::give_up_one() {
  std::vector<std::unique_ptr<Entry>> given_up;  // freed outside the lock
  const absl::MutexLock lock(&mutex_);
  if (!idle_.empty()) give_up_oldest(&given_up);
  return !given_up.empty();
}

void TexturePool::give_up_oldest(std::vector<std::unique_ptr<Entry>>* given_up) {
  CHECK(counters_.bytes_idle >= idle_.front()->bytes);
  counters_.bytes_idle -= idle_.front()->bytes;
  given_up->push_back(std::move(idle_.front()));
  idle_.erase(idle_.begin());
}

void TexturePool::give_back(std::unique_ptr<Entry> entry) {
  std::vector<std::unique_ptr<Entry>> given_up;  // freed outside the lock
  const absl::MutexLock lock(&mutex_);
  CHECK(counters_.bytes_in_use >= entry->bytes);
  counters_.bytes_in_use -= entry->bytes;
  if (entry->buffer.bytes() == 0) return;
  entry->idle_since = clock_.steady();
  while (!idle_.empty() && entry->idle_since - idle_.front()->idle_since > keep_) give_up_oldest(&given_up);
  counters_.bytes_idle += entry->bytes;
  idle_.push_back(std::move(entry));
}

PoolCounters TexturePool::counters() const {
  const absl::MutexLock lock(&mutex_);
  return counters_;
}

TexturePool::Lease::Lease(TexturePool* pool, std::unique_ptr<Entry> entry)
    : pool_(pool), entry_(std::move(entry)) {}

TexturePool::Lease::Lease() = default;
TexturePool::Lease::Lease(Lease&& other) noexcept = default;

TexturePool::Lease& TexturePool::Lease::operator=(Lease&& other) noexcept {
  std::swap(pool_, other.pool_);
  std::swap(entry_, other.entry_);
  return *this;
}

TexturePool::Lease::~Lease() {
  if (entry_) pool_->give_back(std::move(entry_));
}

const Buffer& TexturePool::Lease::buffer() const {
  CHECK(entry_ != nullptr);
  return entry_->buffer;
}

uint64_t TexturePool::Lease::bytes() const { return entry_ ? entry_->bytes : 0; }

}  // namespace candela
