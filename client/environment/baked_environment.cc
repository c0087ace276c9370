#include "client/environment/baked_environment.h"

#include <cmath>

#include "absl/strings/str_format.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

absl::Status check_level(const BakedEnvironment& environment, size_t index) {
  const BakedLevel& level = environment.levels[index];
  const uint32_t wanted = index == 0 ? level.size : environment.levels[index - 1].size / 2;
  if (level.size == 0 || level.size != wanted) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "level %d of the environment has faces of %dx%d texels; they must be %s", index, level.size,
        level.size, index == 0 ? "at least 1x1" : absl::StrFormat("%dx%d", wanted, wanted)));
  }
  const uint64_t bytes = uint64_t{kCubeFaces} * level.size * level.size * bytes_per_texel(environment.format);
  if (level.texels.size() != bytes) {
    return absl::InvalidArgumentError(absl::StrFormat("level %d of the environment has %d bytes; it needs %d",
                                                      index, level.texels.size(), bytes));
  }
  if (!(level.roughness >= 0 && level.roughness <= 1)) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "level %d of the environment has roughness %g; it must be 0 .. 1", index, level.roughness));
  }
  return absl::OkStatus();
}

}  // namespace

const char* name(CubeFormat format) {
  return format == CubeFormat::kRgba32f ? "rgba32f" : format == CubeFormat::kRgba16f ? "rgba16f" : "rgb9e5";
}

const char* name(Handedness handedness) { return handedness == Handedness::kLeft ? "left" : "right"; }

absl::Status check_environment(const BakedEnvironment& environment) {
  if (environment.levels.empty()) return absl::InvalidArgumentError("the environment has no level");
  for (size_t i = 0; i < environment.levels.size(); ++i) {
    RETURN_IF_ERROR(check_level(environment, i));
  }
  return check_harmonics(environment.harmonics);
}

absl::Status check_harmonics(const RadianceHarmonics& harmonics) {
  for (const auto& rgb : harmonics) {
    for (const float value : rgb) {
      if (!std::isfinite(value)) {
        return absl::InvalidArgumentError(
            absl::StrFormat("a spherical harmonic of the environment is %g; it must be finite", value));
      }
    }
  }
  return absl::OkStatus();
}

}  // namespace candela
