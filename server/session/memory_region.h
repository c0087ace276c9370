// Memory that a client on this host shares with this server: docs/transport.md.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <unordered_map>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/status/statusor.h"
#include "absl/synchronization/mutex.h"
#include "candela/v1/render.pb.h"
#include "server/render/frame/frame_memory.h"
#include "server/render/settings/settings.h"
#include "server/session/render_start.h"

namespace candela {

// A sealed memfd of a client, mapped to read and write. The client may write into it at any time. Unmapped
// with its last holder.
class MemoryRegion {
 public:
  // Counts `bytes` of memory before they are mapped, for as long as the result lives.
  using Claim = std::function<absl::StatusOr<std::shared_ptr<const void>>(uint64_t bytes)>;

  // Leaves `descriptor` to the caller. INVALID_ARGUMENT, saying why, unless it is a memfd with the seals, of
  // 1 to v1::kMaxRegionBytes bytes in ordinary pages. Fails as `claim` does, and with RESOURCE_EXHAUSTED if
  // this process has no room for it.
  static absl::StatusOr<std::shared_ptr<MemoryRegion>> map(int descriptor, const Claim& claim);

  ~MemoryRegion();
  MemoryRegion(const MemoryRegion&) = delete;
  MemoryRegion& operator=(const MemoryRegion&) = delete;

  std::byte* data() const { return data_; }
  uint64_t bytes() const { return bytes_; }

 private:
  MemoryRegion(std::byte* data, uint64_t bytes, std::shared_ptr<const void> claim)
      : data_(data), bytes_(bytes), claim_(std::move(claim)) {}

  std::byte* const data_;
  const uint64_t bytes_;
  const std::shared_ptr<const void> claim_;
};

// The regions whose clients are connected, by their tickets. Any thread.
class MemoryRegions {
 public:
  // Returns the region's ticket. INTERNAL if the system has no random bytes.
  absl::StatusOr<std::string> add(std::shared_ptr<MemoryRegion> region);
  // The client has disconnected. The region stays mapped until no frame uses it.
  void remove(const std::string& ticket);
  // UNAVAILABLE if there is none.
  absl::StatusOr<std::shared_ptr<MemoryRegion>> find(const std::string& ticket) const;

  size_t count() const;

  // Whether there is a socket to register at. Set once, before the first call.
  void offer() { offered_ = true; }
  bool offered() const { return offered_; }

 private:
  std::atomic<bool> offered_ = false;
  mutable absl::Mutex mutex_;
  std::unordered_map<std::string, std::shared_ptr<MemoryRegion>> regions_ ABSL_GUARDED_BY(mutex_);
};

// The places of a frame's pixels and of its image of `image` pixels in `format`, if header.memory is set;
// else nothing. `local`: the call came straight from a process of this host. `raw`: its images are sent as
// pixels. Fails as FrameHeader.memory says.
absl::StatusOr<std::optional<ClientPixels>> client_pixels_from(const v1::FrameHeader& header,
                                                               const WireLayout& layout,
                                                               const ImageSize& image,
                                                               v1::OutputFormat format, bool local, bool raw,
                                                               const MemoryRegions& regions);

// Whether no band of the frame comes.
inline bool has_no_bands(const v1::FrameHeader& header) {
  return header.has_view() || header.memory().has_pixels_offset();
}

}  // namespace candela
