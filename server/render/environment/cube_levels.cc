#include "server/render/environment/cube_levels.h"

#include <algorithm>
#include <bit>
#include <cmath>

#include "server/vulkan/pipeline.h"
#include "shaders/environment/environment_params.h"

namespace candela {

static_assert(PipelineCache::kWriteAlignment == 16 * kCubeTexelBytes);

uint32_t default_cube_size(uint32_t panorama_width) {
  return std::clamp(std::bit_ceil((panorama_width + 3) / 4), kMinCubeSize, 2048u);
}

// Smaller cubes have too few specular levels for a rough sphere.
uint32_t view_cube_size(uint32_t panorama_width) { return std::max(default_cube_size(panorama_width), 128u); }

uint32_t cube_samples(uint32_t panorama_width, uint32_t size, uint32_t samples) {
  return samples * std::max(1u, (panorama_width + 4 * size - 1) / (4 * size));
}

uint32_t chain_levels(uint32_t size) { return static_cast<uint32_t>(std::bit_width(size)); }

uint32_t specular_levels(uint32_t size) { return chain_levels(size) - chain_levels(kMinCubeSize) + 1; }

double specular_roughness(uint32_t level, uint32_t levels, RoughnessMapping mapping) {
  if (levels < 2) return 0;
  const double part = static_cast<double>(level) / (levels - 1);
  return mapping == RoughnessMapping::kLinear ? part : 1 - std::sqrt(1 - part);
}

uint64_t CubeLevels::face_texels(uint32_t level) const {
  const uint64_t side = size_of(level) + 2;
  return side * side;
}

uint64_t CubeLevels::start(uint32_t level) const { return CUBE_LEVEL_START(size, size_of(level), level); }

uint64_t cube_bytes(uint32_t size, uint32_t levels) {
  const CubeLevels cube{{}, size, levels};
  return (cube.start(levels - 1) + cube.level_texels(levels - 1)) * kCubeTexelBytes;
}

uint64_t chain_bytes(uint32_t size) { return cube_bytes(size, chain_levels(size)); }

uint64_t specular_bytes(uint32_t size) {
  const uint32_t levels = specular_levels(size);
  return levels > 1 ? cube_bytes(size / 2, levels - 1) : 0;
}

}  // namespace candela
