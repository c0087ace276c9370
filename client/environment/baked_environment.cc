#include "client/environment/baked_environment.h"

#include <cmath>
#include <cstring>
#include <utility>

#include "absl/strings/str_format.h"
#include "client/environment/cube_faces.h"
#include "proto/candela/v1/rgb9e5.h"
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

uint32_t pack(const std::array<float, 3>& rgb, Rgb9e5Losses& losses) {
  for (const float component : rgb) {
    losses.negative += !(component >= 0);
    losses.clamped += component > v1::kMaxRgb9e5;
  }
  return v1::pack_rgb9e5(rgb);
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

absl::StatusOr<Rgb9e5Losses> convert_to_rgb9e5(BakedEnvironment& environment) {
  RETURN_IF_ERROR(check_environment(environment));
  Rgb9e5Losses losses;
  if (environment.format == CubeFormat::kRgb9e5) return losses;
  std::vector<PixelBuffer> packed;
  for (const BakedLevel& level : environment.levels) {
    const uint32_t texel_bytes = bytes_per_texel(environment.format);
    const size_t bytes = level.texels.size() / texel_bytes * 4;
    PixelBuffer& words = packed.emplace_back(bytes);
    if (words.empty()) {
      return absl::ResourceExhaustedError(
          absl::StrFormat("not enough memory for the %d bytes of an RGB9E5 level", bytes));
    }
    for (size_t i = 0; i < words.size() / 4; ++i) {
      const uint32_t word =
          pack(texel_rgb(level.texels.data() + texel_bytes * i, environment.format), losses);
      std::memcpy(words.data() + 4 * i, &word, 4);
    }
  }
  for (size_t i = 0; i < packed.size(); ++i) environment.levels[i].texels = std::move(packed[i]);
  environment.format = CubeFormat::kRgb9e5;
  return losses;
}

}  // namespace candela
