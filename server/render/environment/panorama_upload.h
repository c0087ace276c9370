// The memory of a panorama while its pixels arrive.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "absl/status/statusor.h"
#include "server/render/frame/texture_pool.h"
#include "server/render/settings/frame.h"

namespace candela {

// Taken from the pool, and given back to it on destruction. Movable. One thread at a time.
class PanoramaUpload {
 public:
  // Allocates everything or nothing. RESOURCE_EXHAUSTED if the device or the pool's budget can never hold it,
  // before anything is allocated; otherwise fails as TexturePool::take() does. `pool` outlives the memory.
  static absl::StatusOr<PanoramaUpload> take(TexturePool& pool, const DeviceSummary& device,
                                             const FrameDesc& desc);

  const FrameDesc& desc() const { return desc_; }
  // The memory for row y of the wire pixels: desc().row_bytes() bytes. Write each byte once and do not read
  // it.
  std::span<std::byte> row(uint32_t y);
  // Of the pool's budget, until the panorama is finished, and what an environment keeps of it.
  uint64_t bytes() const;
  uint64_t kept_bytes() const { return panorama_.bytes(); }

 private:
  friend class EnvironmentBaker;
  FrameDesc desc_;
  uint32_t pitch_ = 0;  // texels from row to row, of the wire's pixels and of the panorama
  TexturePool::Lease wire_;
  TexturePool::Lease staged_;  // only on a device without unified memory
  TexturePool::Lease panorama_;
};

}  // namespace candela
