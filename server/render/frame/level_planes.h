// A bloom level as the host's passes keep it in the level's texture: rows of R, of G and of B one after the
// other. Filters along rows and columns then need no shuffles.
#pragma once

#include <cstddef>
#include <cstdint>

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
