// Bilinear lookups in a level of a cube map, without seams (docs/environments.md section 2).
#pragma once

#include <array>
#include <cstdint>

#include "client/environment/baked_environment.h"

namespace candela {

// Reads the environment's texels where they are; the environment must outlive it.
class CubeLookup {
 public:
  CubeLookup(const BakedEnvironment& environment, size_t level)
      : level_(environment.levels[level]), format_(environment.format) {}

  // R, G and B in the world's direction d, which need not have length 1 but must not be 0.
  std::array<float, 3> at(const std::array<float, 3>& d) const;

 private:
  using Rgb = std::array<float, 3>;
  Rgb texel(uint32_t face, int i, int j) const;
  // Texel (i, j), of which one or both may be -1 or the size: beyond an edge or a corner.
  Rgb tap(uint32_t face, int i, int j) const;
  // The same beyond one edge: the neighbour's texel.
  Rgb beyond_edge(uint32_t face, int i, int j) const;

  const BakedLevel& level_;
  CubeFormat format_;
};

}  // namespace candela
