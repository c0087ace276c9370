// A hash of 32-bit numbers, the source of the noise in test scenes.
#pragma once

#include <cstdint>

namespace candela {

// PCG. Source: M. Jarzynski and M. Olano, "Hash Functions for GPU Rendering", JCGT 9(3), 2020.
constexpr uint32_t pcg_hash(uint32_t v) {
  v = v * 747796405u + 2891336453u;
  v = ((v >> ((v >> 28) + 4u)) ^ v) * 277803737u;
  return (v >> 22) ^ v;
}

}  // namespace candela
