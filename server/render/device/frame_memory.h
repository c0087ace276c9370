// The inside of FrameMemory. Internal to server/render.
#pragma once

#include <vector>

#include "server/render/renderer.h"
#include "shaders/params.h"

namespace candela {

struct FrameMemory::Parts {
  FrameDesc desc;
  OutputFormat output_format = OutputFormat::kRgba8;
  uint64_t bytes = 0;  // of the pool's budget, for all that follows
  uint32_t pitch = 0;  // texels from row to row of input and output: the width in whole groups
  uint32_t tiles_x = 0;
  uint32_t tiles_y = 0;
  std::vector<LevelSize> level_sizes;  // empty where the settings ask for no bloom

  TexturePool::Lease input;
  TexturePool::Lease output;
  TexturePool::Lease tiles;
  uint32_t histogram_copies =
      0;  // see shader::HISTOGRAM_TILES; 0 where the settings ask for no percentile and no histogram
  TexturePool::Lease histogram;
  TexturePool::Lease center_weights;  // of MeterWeights::kCenter
  std::vector<TexturePool::Lease> levels;
  // Only on a device without unified memory.
  TexturePool::Lease upload;
  TexturePool::Lease readback;
  TexturePool::Lease tiles_readback;
  TexturePool::Lease histogram_readback;

  // Only for verification: the image unquantised, four floats a texel, `pitch` texels from row to row; the
  // budget that the reference takes; and, where it is wanted, the error map.
  TexturePool::Lease exact;
  TexturePool::Lease reference;
  TexturePool::Lease error_map;
  // The same on a device without unified memory, with bloom level 0.
  TexturePool::Lease exact_readback;
  TexturePool::Lease level_readback;

  // What the host sees.
  const Buffer& host_input() const { return upload ? upload.buffer() : input.buffer(); }
  const Buffer& host_output() const { return readback ? readback.buffer() : output.buffer(); }
  const Buffer& host_tiles() const { return tiles_readback ? tiles_readback.buffer() : tiles.buffer(); }
  const Buffer& host_histogram() const {
    return histogram_readback ? histogram_readback.buffer() : histogram.buffer();
  }
  const Buffer& host_exact() const { return exact_readback ? exact_readback.buffer() : exact.buffer(); }
  const Buffer& host_level() const { return level_readback ? level_readback.buffer() : levels[0].buffer(); }
};

// How many groups of `size` hold `count`.
constexpr uint32_t groups(uint32_t count, uint32_t size) { return (count + size - 1) / size; }

// Takes everything or nothing; see Renderer::allocate.
absl::StatusOr<std::unique_ptr<FrameMemory::Parts>> take_parts(TexturePool& pool, const DeviceSummary& device,
                                                               const FrameDesc& desc,
                                                               const Settings& settings, Verify verify);

}  // namespace candela
