// A panorama that the server keeps, and what has been baked of it for its views (docs/environments.md).
#pragma once

#include <cstdint>
#include <optional>

#include "server/render/environment/cube_levels.h"
#include "server/render/environment/harmonics.h"
#include "server/render/frame/texture_pool.h"
#include "shaders/environment/environment_params.h"

namespace candela {

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
