// Levels of a cube map on the device, one behind the other, each half as large as the one before.
#pragma once

#include <cstdint>

#include "server/render/frame/texture_pool.h"

namespace candela {

inline constexpr uint32_t kMinCubeSize = 16;
inline constexpr uint32_t kMaxCubeSize = 4096;
inline constexpr uint32_t kCubeFaces = 6;
// Bytes of a stored texel: four floats, of which the last is not used.
inline constexpr uint64_t kCubeTexelBytes = 16;

// Sizes follow docs/environments.md section 2.
//
// The size of a cube map for a panorama of this width, if nobody asks for another one.
uint32_t default_cube_size(uint32_t panorama_width);
// The size that views read.
uint32_t view_cube_size(uint32_t panorama_width);
// K: sub-texels along a side of a texel of level 0. `samples` is the tier's.
uint32_t cube_samples(uint32_t panorama_width, uint32_t size, uint32_t samples);
// The number of levels from `size` down to 1 x 1, and the number of specular levels: from `size` down to 16 x
// 16.
uint32_t chain_levels(uint32_t size);
uint32_t specular_levels(uint32_t size);

// How the roughness of the levels grows (section 4): i / (n - 1), or 1 - sqrt(1 - i / (n - 1)).
enum class RoughnessMapping { kLinear, kPerceptual };

// The roughness of specular level `level` of `levels`, 0 .. 1.
double specular_roughness(uint32_t level, uint32_t levels, RoughnessMapping mapping);

// Movable. Empty: no lease.
struct CubeLevels {
  TexturePool::Lease texels;
  uint32_t size = 0;  // of level 0, along a side
  uint32_t levels = 0;

  uint32_t size_of(uint32_t level) const { return size >> level; }
  // A face with its border, and all six of them.
  uint64_t face_texels(uint32_t level) const;
  uint64_t level_texels(uint32_t level) const { return kCubeFaces * face_texels(level); }
  // The first texel of a level in the buffer.
  uint64_t start(uint32_t level) const;
  explicit operator bool() const { return static_cast<bool>(texels); }
};

// The bytes of `levels` levels, from `size` on.
uint64_t cube_bytes(uint32_t size, uint32_t levels);
// The bytes of the whole chain, and of all specular levels but the first, which is the chain's own.
uint64_t chain_bytes(uint32_t size);
uint64_t specular_bytes(uint32_t size);

}  // namespace candela
