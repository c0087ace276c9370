// Twin of cube_down.comp: the levels below level 0 of a cube map.
#include <utility>

#include "shaders/environment/environment.h"

namespace candela::reference {

CubeLevel cube_down(const CubeLevel& level) {
  CubeLevel out{level.size / 2, {}};
  out.texels.reserve(size_t{6} * out.size * out.size);
  for (uint32_t row = 0; row < 6 * out.size; ++row) {
    const uint32_t face = row / out.size;
    const uint32_t j = row % out.size;
    for (uint32_t i = 0; i < out.size; ++i) {
      Rgb sum{};
      double weights = 0.0;
      for (uint32_t k = 0; k < 4; ++k) {
        const uint32_t x = 2 * i + k % 2;
        const uint32_t y = 2 * j + k / 2;
        const double weight = cube_solid_angle(x, y, level.size);
        accumulate(&sum, level.at(face, x, y), weight);
        weights += weight;
      }
      accumulate(&out.texels.emplace_back(), sum, 1.0 / weights);
    }
    row_done();
  }
  return out;
}

std::vector<CubeLevel> cube_chain(CubeLevel level) {
  std::vector<CubeLevel> chain{std::move(level)};
  while (chain.back().size > 1) chain.push_back(cube_down(chain.back()));
  return chain;
}

}  // namespace candela::reference
