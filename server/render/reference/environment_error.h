// The error of a baked cube map's levels, against the float64 twins (docs/environments.md section 7).
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "shaders/environment/environment.h"

namespace candela {

// A level as the baker read it back: six faces of size x size texels, R, G and B of each, row by row.
struct BakedFaces {
  uint32_t size = 0;
  double roughness = 0.0;
  std::span<const std::vector<float>> faces;
};

// sum |level - exact| / sum |exact| over R, G and B at the texels nearest to 64 directions that are spread
// over the sphere; 0 for a black panorama. `rotation_deg` is the environment's. Level 0 is compared with the
// mean over the tier reference's sub-texels. Takes up to a second, and goes through checkpoint().
double level_error(const reference::Scene& panorama, const BakedFaces& level, double rotation_deg);

}  // namespace candela
