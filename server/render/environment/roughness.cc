#include "server/render/environment/roughness.h"

#include <cmath>

namespace candela {

double specular_roughness(uint32_t level, uint32_t levels, RoughnessMapping mapping) {
  if (levels < 2) return 0;
  const double part = static_cast<double>(level) / (levels - 1);
  return mapping == RoughnessMapping::kLinear ? part : 1 - std::sqrt(1 - part);
}

}  // namespace candela
