// The roughness of specular levels (docs/environments.md section 4).
#pragma once

#include <cstdint>

namespace candela {

// How the roughness of the levels grows: i / (n - 1), or 1 - sqrt(1 - i / (n - 1)).
enum class RoughnessMapping { kLinear, kPerceptual };

// The roughness of specular level `level` of `levels`, 0 .. 1.
double specular_roughness(uint32_t level, uint32_t levels, RoughnessMapping mapping);

}  // namespace candela
