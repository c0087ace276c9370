// Memory that a session shares with a server.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/synchronization/mutex.h"
#include "candela/v1/render.pb.h"
#include "client/session.h"

namespace candela {

// Memory that this process shares with a candelad on this host: docs/transport.md.
//
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

// The memory that a session shares with the server of its call.
//
// A region belongs to one call, because the server may still draw into it when that is lost. It is made when
// the first frame is there, whose size it fits; a larger frame makes another one. Any thread.
class SessionMemory {
 public:
  explicit SessionMemory(Transport transport)
      : allowed_(transport == Transport::kAuto || transport == Transport::kMemory) {}

  // A call to `address` begins.
  void begin_call(const std::string& address);
  // The call was lost without a result. Shared memory may be the cause, so this session makes no more
  // regions.
  void give_up();

  // Room for a frame of `bytes`, in a region that also has room for `window` frames of this size and their
  // images of `image_bytes`. Nothing if memory cannot be shared, or if all areas are in use. Waits until the
  // server has registered a new region, but never for a call.
  SharedRegion::Area area(uint64_t bytes, uint64_t image_bytes, uint32_t window);

  // The region of the call; null if it has none.
  std::shared_ptr<SharedRegion> region() const;

  // OK if the server of the call registers regions.
  absl::Status check() const;

 private:
  void make(uint64_t bytes, uint64_t image_bytes, uint32_t window);

  mutable absl::Mutex mutex_;
  bool allowed_ ABSL_GUARDED_BY(mutex_);
  bool making_ ABSL_GUARDED_BY(mutex_) = false;
  std::string path_
      ABSL_GUARDED_BY(mutex_);  // of the call's server; empty: not a unix socket, or it has refused
  uint64_t calls_ ABSL_GUARDED_BY(mutex_) = 0;
  std::shared_ptr<SharedRegion> region_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace candela
