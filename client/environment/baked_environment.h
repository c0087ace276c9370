// A baked environment in memory: the specular levels of a cube map, and its spherical harmonics.
//
// docs/environments.md defines what they are; section 2 the faces and directions of texels. The functions of
// this folder need no network and no device, and keep no state: any thread may call them.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "absl/status/status.h"
#include "client/image/image.h"

namespace candela {

// A texel of a cube map: four halves or floats (R, G, B and an alpha of 1), or one RGB9E5 word. Little
// endian.
enum class CubeFormat { kRgba16f, kRgb9e5, kRgba32f };

constexpr uint32_t bytes_per_texel(CubeFormat format) {
  return format == CubeFormat::kRgba32f ? 16 : format == CubeFormat::kRgba16f ? 8 : 4;
}

const char* name(CubeFormat format);  // "rgba16f"

// How a cube map in a file is to be sampled for the world's direction d. Texels in memory are always those of
// kRight.
enum class Handedness {
  kLeft,   // with (-d.x, d.y, d.z). Every face is an unmirrored picture, as KTX2 asks. three.js does this
  kRight,  // with d. Every face is mirrored. Filament and Khronos' glTF viewer do this
};

const char* name(Handedness handedness);  // "left"

inline constexpr uint32_t kCubeFaces = 6;  // +X -X +Y -Y +Z -Z, in this order everywhere

struct BakedLevel {
  uint32_t size = 0;       // of a face, in texels on a side
  float roughness = 0.0f;  // 0 .. 1
  PixelBuffer texels;      // the six faces, each row by row without padding
};

// L_lm of R, G and B, in the order (l, m) = (0,0) (1,-1) (1,0) (1,1) (2,-2) .. (2,2).
using RadianceHarmonics = std::array<std::array<float, 3>, 9>;

struct BakedEnvironment {
  CubeFormat format = CubeFormat::kRgba16f;
  Handedness handedness = Handedness::kLeft;  // of cube maps in files
  std::vector<BakedLevel> levels;             // the largest first, each half as large as the one before
  RadianceHarmonics harmonics{};
};

// INVALID_ARGUMENT, in one line, if there is no level, or if sizes, bytes, roughness or harmonics are not as
// above.
absl::Status check_environment(const BakedEnvironment& environment);
absl::Status check_harmonics(const RadianceHarmonics& harmonics);

}  // namespace candela
