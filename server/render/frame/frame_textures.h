// The textures of a frame, and a bloom level as the host's passes keep it.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "server/render/frame/frame_memory.h"
#include "server/render/frame/texture_pool.h"
#include "server/render/plan/texture_layout.h"
#include "shaders/reference.h"

namespace candela::host {

struct LevelPlanes {
  float* floats = nullptr;
  uint32_t width = 0;
  uint32_t height = 0;

  // Floats from row to row of a component. Rows begin at cache lines if the texture, which has four floats a
  // texel, is large enough for that.
  size_t stride() const {
    const size_t lines = (size_t{width} + 15) / 16 * 16;
    return 3 * lines <= 4 * size_t{width} ? lines : width;
  }
  float* row(size_t y, size_t component) const { return floats + (3 * y + component) * stride(); }
};

}  // namespace candela::host

namespace candela {

// The textures of one frame. Internal to server/render and its tests.

// A scene that the float64 reference has made of the wire pixels and metered.
struct MeteredScene {
  reference::Scene scene;
  reference::BadCounts bad;
  reference::Meter meter;
};

enum class FrameStage { kTaken, kMetered, kDrawn, kOutputOnly };

struct FrameTextures {
  TextureLayout layout;
  FrameStage stage = FrameStage::kTaken;
  uint64_t bytes = 0;                  // of the pool's budget, for all that follows
  std::unique_ptr<MemoryClaim> claim;  // may be null

  TexturePool::Lease input;
  TexturePool::Lease output;
  TexturePool::Lease tiles;
  TexturePool::Lease histogram;
  TexturePool::Lease center_weights;
  std::vector<TexturePool::Lease> levels;
  // Only if the image has another size: a block of rows that are resized along y, the resized scene, and the
  // weights of both axes for the device.
  TexturePool::Lease resize_block;
  TexturePool::Lease scene;
  TexturePool::Lease resize_weights;
  bool planar_levels = false;  // the host has drawn them: see LevelPlanes
  // Only on a device without unified memory.
  TexturePool::Lease upload;
  TexturePool::Lease readback;
  TexturePool::Lease tiles_readback;
  TexturePool::Lease histogram_readback;

  // Only for verification: the unquantised image, four floats a texel and `layout.image_pitch` texels from
  // row to row, and the error map if it is wanted.
  TexturePool::Lease exact;
  TexturePool::Lease error_map;
  // Only for verification on a device without unified memory; the second is bloom level 0.
  TexturePool::Lease exact_readback;
  TexturePool::Lease level_readback;

  // Only if the reference renders or verifies the frame: the part of the budget that it uses.
  TexturePool::Lease reference;
  // The metered scene, kept from the reference's metering to its rendering.
  std::optional<MeteredScene> metered_scene;

  ClientPixels client;
  bool client_has_image = false;  // the last drawing went to client.image

  // Copies rows first .. last - 1 of `from` to their place in the input.
  void copy_rows(const ClientPixels& from, uint32_t first, uint32_t last) const;

  // The buffers that the host reads and writes.
  const Buffer& host_input() const { return upload ? upload.buffer() : input.buffer(); }
  const Buffer& host_output() const { return readback ? readback.buffer() : output.buffer(); }
  const Buffer& host_tiles() const { return tiles_readback ? tiles_readback.buffer() : tiles.buffer(); }
  const Buffer& host_histogram() const {
    return histogram_readback ? histogram_readback.buffer() : histogram.buffer();
  }
  const Buffer& host_exact() const { return exact_readback ? exact_readback.buffer() : exact.buffer(); }
  const Buffer& host_level() const { return level_readback ? level_readback.buffer() : levels[0].buffer(); }
};

// The light of a bloom level, whoever made it. For verification and tests.
class LevelView {
 public:
  // `texels` holds the level, mapped.
  LevelView(const FrameTextures& textures, const LevelSize& size, const Buffer& texels)
      : planar_(textures.planar_levels), size_(size), texels_(reinterpret_cast<float*>(texels.mapped())) {}

  const LevelSize& size() const { return size_; }

  std::array<float, 3> at(size_t x, size_t y) const {
    if (!planar_) {
      const float* const texel = texels_ + 4 * (y * size_.width + x);
      return {texel[0], texel[1], texel[2]};
    }
    const host::LevelPlanes planes = {texels_, size_.width, size_.height};
    return {planes.row(y, 0)[x], planes.row(y, 1)[x], planes.row(y, 2)[x]};
  }

 private:
  bool planar_;
  LevelSize size_;
  float* texels_;
};

}  // namespace candela
