// The memory that a session shares with the server of its call.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/synchronization/mutex.h"
#include "candela/v1/render.pb.h"
#include "client/call/memory/shared_region.h"
#include "client/session.h"

namespace candela {

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
