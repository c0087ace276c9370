// Memory that this process shares with a candelad on this host: docs/transport.md.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>

#include "absl/base/thread_annotations.h"
#include "absl/status/statusor.h"
#include "absl/synchronization/mutex.h"

namespace candela {

// Registered with the server while this object lives, which is as long as one of its areas does. Any thread.
class SharedRegion : public std::enable_shared_from_this<SharedRegion> {
 public:
  // A part of a region, whose last holder gives it back.
  struct Area {
    std::shared_ptr<std::byte> bytes;  // null: none
    size_t size = 0;
    uint64_t offset = 0;  // in the region
  };

  // Makes a region of `bytes` and registers it at the server whose gRPC socket is at `path`. UNAVAILABLE if
  // there is no such server, or it does not answer within 2 s; else as the server answers.
  static absl::StatusOr<std::shared_ptr<SharedRegion>> create(const std::string& path, uint64_t bytes);

  ~SharedRegion();
  SharedRegion(const SharedRegion&) = delete;
  SharedRegion& operator=(const SharedRegion&) = delete;

  // An area of `bytes` that no other area overlaps. It still holds what was last written there. Nothing if
  // there is no room.
  Area take(uint64_t bytes);
  // The offset of `bytes`; none if a part of them is outside, or if no frame may begin there.
  std::optional<uint64_t> offset_of(std::span<const std::byte> bytes) const;

  const std::string& ticket() const { return ticket_; }
  uint64_t bytes() const { return bytes_; }

  // The room that an area of `bytes` takes.
  static uint64_t room_of(uint64_t bytes);

 private:
  SharedRegion() = default;
  void populate(uint64_t end) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  std::byte* data_ = nullptr;
  uint64_t bytes_ = 0;
  int connection_ = -1;
  std::string ticket_;
  absl::Mutex mutex_;
  uint64_t populated_ ABSL_GUARDED_BY(mutex_) = 0;              // bytes from the start; whole pages
  std::map<uint64_t, uint64_t> taken_ ABSL_GUARDED_BY(mutex_);  // from offsets to the ends of their areas
};

}  // namespace candela
