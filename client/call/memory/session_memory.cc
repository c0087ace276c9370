#include "client/call/memory/session_memory.h"

#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/strip.h"

namespace candela {
namespace {

// A frame that is being filled, and one that waits to be submitted, beside those in flight.
constexpr uint64_t kFramesAhead = 2;

// "" if it is no unix socket.
std::string path_of(absl::string_view address) {
  if (!absl::ConsumePrefix(&address, "unix:")) return "";
  if (absl::StartsWith(address, "//")) address.remove_prefix(2);
  return std::string(address);
}

}  // namespace

void SessionMemory::begin_call(const std::string& address) {
  std::shared_ptr<SharedRegion> last;  // goes without the lock
  const absl::MutexLock lock(&mutex_);
  last = std::move(region_);
  path_ = allowed_ ? path_of(address) : "";
  ++calls_;
}

void SessionMemory::give_up() {
  const absl::MutexLock lock(&mutex_);
  allowed_ = false;
}

SharedRegion::Area SessionMemory::area(uint64_t bytes, uint64_t image_bytes, uint32_t window) {
  std::shared_ptr<SharedRegion> now = region();
  if (now == nullptr || now->bytes() < SharedRegion::room_of(bytes) + SharedRegion::room_of(image_bytes)) {
    make(bytes, image_bytes, window);
    now = region();
  }
  return now == nullptr ? SharedRegion::Area() : now->take(bytes);
}

// If two threads need a region, the first one makes it, and the second one's frame goes in bands.
void SessionMemory::make(uint64_t bytes, uint64_t image_bytes, uint32_t window) {
  std::string path;
  uint64_t call = 0;
  {
    const absl::MutexLock lock(&mutex_);
    if (path_.empty() || making_) return;
    making_ = true;
    path = path_;
    call = calls_;
  }
  // Images: those in flight, as many results that wait, and one that is looked at.
  const uint64_t wanted = (window + kFramesAhead) * SharedRegion::room_of(bytes) +
                          (2 * uint64_t{window} + 1) * SharedRegion::room_of(image_bytes);
  absl::StatusOr<std::shared_ptr<SharedRegion>> made = SharedRegion::create(path, wanted);
  std::shared_ptr<SharedRegion> last;
  const absl::MutexLock lock(&mutex_);
  making_ = false;
  if (call != calls_) return;
  if (made.ok()) {
    last = std::exchange(region_, *std::move(made));
  } else {
    path_.clear();
  }
}

std::shared_ptr<SharedRegion> SessionMemory::region() const {
  const absl::MutexLock lock(&mutex_);
  return region_;
}

absl::Status SessionMemory::check() const {
  std::string path;
  {
    const absl::MutexLock lock(&mutex_);
    path = path_;
  }
  if (path.empty()) {
    return absl::InvalidArgumentError(
        "memory can be shared with a server at unix:PATH only; use the transport auto or grpc");
  }
  return SharedRegion::create(path, 1).status();
}

}  // namespace candela
