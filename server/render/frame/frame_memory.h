// The memory of one frame: the wire pixels that come in, the image that goes out, and the textures between.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>

#include "absl/status/statusor.h"
#include "server/render/settings/settings.h"

namespace candela {

class TexturePool;
struct DeviceSummary;
struct TextureLayout;
struct FrameTextures;

// Whether a frame is compared with the float64 reference, and whether a map of its error is kept.
enum class Verify { kNo, kYes, kWithMap };

// Counts a frame's memory for the client that the frame belongs to. Destroyed with the memory. Any thread.
class MemoryClaim {
 public:
  virtual ~MemoryClaim() = default;
  // From now on the frame has only `bytes`.
  virtual void shrink(uint64_t bytes) = 0;
};

// Memory that a client shares, in place of bands. The client may write into it at any time.
struct ClientPixels {
  std::shared_ptr<const void> owner;  // keeps it mapped
  const std::byte* rows = nullptr;    // the wire's first row; null: the pixels come in bands
  uint64_t row_stride_bytes = 0;
  std::byte* image = nullptr;  // where the image goes, tight; null: it stays in the frame's memory
};

// Taken from the pool, and given back to it on destruction. Movable. One thread at a time.
class FrameMemory {
 public:
  // Takes everything or nothing; fails as FrameMaker::allocate does. `pool` outlives the memory.
  static absl::StatusOr<FrameMemory> take(TexturePool& pool, const DeviceSummary& device,
                                          const TextureLayout& layout, Verify verify);
  // The part of the budget that take() takes. RESOURCE_EXHAUSTED if the whole budget is less.
  static absl::StatusOr<uint64_t> bytes_for(const TexturePool& pool, const DeviceSummary& device,
                                            const TextureLayout& layout, Verify verify);

  FrameMemory();  // none
  FrameMemory(FrameMemory&&) noexcept;
  FrameMemory& operator=(FrameMemory&&) noexcept;
  ~FrameMemory();

  const FrameDesc& desc() const;
  // The size of the finished image and of its error map.
  const ImageSize& image() const;
  // The memory for row y of the wire pixels: desc().row_bytes() bytes. Write each byte once and do not read
  // it, because the memory may be uncached.
  std::span<std::byte> input_row(uint32_t y);
  // Row y of the finished image, tight: image().width * bytes_per_pixel(output). Valid from the success of
  // render() until destruction. Cached memory. `output_contiguous` says whether rows follow each other
  // without a gap.
  std::span<const std::byte> output_row(uint32_t y) const;
  bool output_contiguous() const;
  // Row y of the error map as halves: the largest error of R, G and B in codes, infinite for a NaN. Rows
  // follow each other without a gap. Valid as output_row() is; empty without Verify::kWithMap.
  std::span<const uint16_t> error_map_row(uint32_t y) const;
  // True if rendering the frame may take longer than a slice (server/base/slices.h): it is large, or the
  // float64 reference renders or verifies it.
  bool takes_long() const;
  // The part of the pool's budget that it takes at first.
  uint64_t bytes() const;
  // Gives everything but the finished image and its error map back to the pool, so that a slow reader holds
  // only what it still has to read.
  void keep_output_only();
  // After keep_output_only(): a file of `bytes` was made of the image. Gives the image's memory back to the
  // pool. The claim then counts the file.
  void replace_output(uint64_t bytes);
  // Call this before the frame is metered. Metering then copies the rows from the client's memory and reads
  // each row once. The image goes to the client's memory, and keep_output_only() leaves none here.
  void share(ClientPixels pixels);
  // The claim that counts the memory from now on. Call this once.
  void account(std::unique_ptr<MemoryClaim> claim);

  // The rest is for server/render and its tests.
  FrameTextures& textures() { return *textures_; }
  const FrameTextures& textures() const { return *textures_; }

 private:
  std::unique_ptr<FrameTextures> textures_;
};

}  // namespace candela
