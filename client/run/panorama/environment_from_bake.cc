#include "client/run/panorama/environment_from_bake.h"

#include <algorithm>
#include <cstring>
#include <utility>

namespace candela {

absl::StatusOr<BakedEnvironment> environment_from(const EnvironmentBake& bake, Handedness handedness) {
  BakedEnvironment environment;
  environment.format = bake.format == v1::PIXEL_FORMAT_RGB9E5    ? CubeFormat::kRgb9e5
                       : bake.format == v1::PIXEL_FORMAT_RGBA32F ? CubeFormat::kRgba32f
                                                                 : CubeFormat::kRgba16f;
  environment.handedness = handedness;
  for (size_t i = 0; i < bake.levels.size(); ++i) {
    const v1::BakedLevel& level = bake.header.levels(static_cast<int>(i));
    PixelBuffer texels(bake.levels[i].size());
    if (texels.empty())
      return absl::ResourceExhaustedError(
          "out of memory for the cube map; give this process more memory (ulimit -v)");
    std::memcpy(texels.data(), bake.levels[i].data(), bake.levels[i].size());
    environment.levels.push_back({level.size(), static_cast<float>(level.roughness()), std::move(texels)});
  }
  const auto& sh = bake.header.radiance_sh();
  for (int i = 0; i < std::min(sh.size(), 27); ++i) {
    environment.harmonics[static_cast<size_t>(i / 3)][static_cast<size_t>(i % 3)] = static_cast<float>(sh[i]);
  }
  return environment;
}

}  // namespace candela
