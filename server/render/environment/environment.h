// A baked environment: the levels of its cube, and its spherical harmonics.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "server/render/frame/texture_pool.h"
#include "shaders/environment/environment_params.h"

namespace candela {

// Levels of a cube map on the device, one behind the other, each half as large as the one before.

inline constexpr uint32_t kMinCubeSize = 16;
inline constexpr uint32_t kMaxCubeSize = 4096;
inline constexpr uint32_t kCubeFaces = 6;
// Bytes of a stored texel: four floats, of which the last is not used.
inline constexpr uint64_t kCubeTexelBytes = 16;

// Sizes follow docs/environments.md section 2.
//
// The size of a cube map for a panorama of this width, if nobody asks for another one.
uint32_t default_cube_size(uint32_t panorama_width);
// The size that views read.
uint32_t view_cube_size(uint32_t panorama_width);
// K: sub-texels along a side of a texel of level 0. `samples` is the tier's.
uint32_t cube_samples(uint32_t panorama_width, uint32_t size, uint32_t samples);
// The number of levels from `size` down to 1 x 1, and the number of specular levels: from `size` down to 16 x
// 16.
uint32_t chain_levels(uint32_t size);
uint32_t specular_levels(uint32_t size);

// How the roughness of the levels grows (section 4): i / (n - 1), or 1 - sqrt(1 - i / (n - 1)).
enum class RoughnessMapping { kLinear, kPerceptual };

// The roughness of specular level `level` of `levels`, 0 .. 1.
double specular_roughness(uint32_t level, uint32_t levels, RoughnessMapping mapping);

// Movable. Empty: no lease.
struct CubeLevels {
  TexturePool::Lease texels;
  uint32_t size = 0;  // of level 0, along a side
  uint32_t levels = 0;

  uint32_t size_of(uint32_t level) const { return size >> level; }
  // A face with its border, and all six of them.
  uint64_t face_texels(uint32_t level) const;
  uint64_t level_texels(uint32_t level) const { return kCubeFaces * face_texels(level); }
  // The first texel of a level in the buffer.
  uint64_t start(uint32_t level) const;
  explicit operator bool() const { return static_cast<bool>(texels); }
};

// The bytes of `levels` levels, from `size` on.
uint64_t cube_bytes(uint32_t size, uint32_t levels);
// The bytes of the whole chain, and of all specular levels but the first, which is the chain's own.
uint64_t chain_bytes(uint32_t size);
uint64_t specular_bytes(uint32_t size);

// Spherical harmonics of a panorama (docs/environments.md section 3): the host's part, in double.

// Nine coefficients of R, G and B, in the order of (l, m): (0,0) (1,-1) (1,0) (1,1) (2,-2) .. (2,2).
using Harmonics = std::array<std::array<double, 3>, 9>;

// The constant factors of the nine polynomials in a direction's x, y and z.
extern const std::array<double, 9> kHarmonicFactors;

// The integrals of sin lon, cos lon, sin 2 lon and cos 2 lon over each column.
std::vector<std::array<float, 4>> column_factors(uint32_t width);

// L_lm of the partial sums that panorama_sh made: SH_PARTS times 16 floats for each row.
Harmonics radiance_of(std::span<const float> sums, uint32_t width, uint32_t height);

// The same for the environment turned by `rotation_deg` about +Y.
Harmonics turned(const Harmonics& radiance, double rotation_deg);

// A_l L_lm.
Harmonics irradiance_of(const Harmonics& radiance);

// A panorama that the server keeps, and what has been baked of it for its views (docs/environments.md).

// How finely an environment is baked. server/render/settings/tiers.h has each tier's numbers.
struct BakeQuality {
  uint32_t cube_samples = 4;  // K of a panorama whose texels are as large as those of level 0
  // The largest side of a texel that a specular level takes whole, by the distance over which the lobe
  // changes there; 0: no specular levels.
  double specular_detail = 0.0;
  bool operator==(const BakeQuality&) const = default;
};

struct BakeSpec {
  uint32_t size = 0;    // N: a power of two, 16 .. 4096; 0: the default
  uint32_t levels = 0;  // specular levels to make, level 0 among them; 0: all
  RoughnessMapping mapping = RoughnessMapping::kLinear;
  double rotation_deg = 0.0;
  BakeQuality quality;
  bool operator==(const BakeSpec&) const = default;
};

// Counts over the R, G and B components on the wire.
struct PanoramaBadValues {
  uint64_t nan = 0;
  uint64_t infinite = 0;
  uint64_t negative = 0;
  uint64_t clamped = 0;                     // finite and beyond +-2^30, on the wire or after the matrix
  std::optional<uint64_t> first_bad_texel;  // y * width + x of the first with a NaN, an Inf or one of these
};

// A chain and its specular levels. Movable.
struct BakedCube {
  BakeSpec spec;        // with its size
  CubeLevels chain;     // from max(N, N0) down to 1 x 1, or to N if the spec's `levels` is 1
  uint32_t first = 0;   // the chain's level of size N, which is the specular level of roughness 0
  CubeLevels specular;  // those after that one that were made, from N / 2 on; empty if there are none

  uint64_t bytes() const { return chain.texels.bytes() + specular.texels.bytes(); }
};

// Movable. The pool outlives it. One thread at a time.
struct Environment {
  uint32_t width = 0;
  uint32_t height = 0;
  uint32_t pitch = 0;  // texels from row to row
  PanoramaBadValues bad;
  TexturePool::Lease panorama;        // RGBA halves, or floats
  bool floats = false;                // some component is beyond the largest half
  std::optional<Harmonics> radiance;  // L_lm, once somebody has asked for it
  BakedCube view;                     // what views read, once there was one; the mapping is perceptual

  // The part of the pool's budget that it holds.
  uint64_t bytes() const { return panorama.bytes() + view.bytes(); }
};

}  // namespace candela
