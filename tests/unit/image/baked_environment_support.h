// Helpers for the tests of client/environment: environments whose texels say which direction they show, and a
// reader of KTX 2.0 files that shares no code with the writer.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "client/environment/baked_environment.h"

namespace candela {

using Vector = std::array<double, 3>;

// The point of the cube with corners at +-1 that texel (i, j) of a face shows: the table of
// docs/environments.md section 2, which is also that of every graphics interface.
Vector cube_point(uint32_t face, uint32_t i, uint32_t j, uint32_t size);

// An environment with the given sizes, in halves. `texel` gives R, G and B for a level and a point of the
// cube in world axes. Roughness rises evenly from 0 to 1; the harmonics are 1, 2 .. 27 thirds.
using WorldFunction = std::function<Vector(size_t level, const Vector& point)>;
BakedEnvironment environment_of(const std::vector<uint32_t>& sizes, const WorldFunction& texel);

// From halves.
void convert_to_floats(BakedEnvironment& environment);
void convert_to_rgb9e5(BakedEnvironment& environment);

// (2 + point) 2^level: exact in halves and in RGB9E5 for sizes up to 64, and different in every texel.
Vector telling(size_t level, const Vector& point);

// A room whose walls +X -X +Y -Y +Z -Z differ in colour. On each is an arrow of (10, 10, 10) that points up,
// or ahead (-Z) on ceiling and floor, with a flag halfway up the shaft: on the right of somebody who looks at
// the wall, or towards +X on ceiling and floor.
Vector arrows(size_t level, const Vector& point);

// Fails the test unless `texel`, of faces of arrows() in a file, has each arrow where an engine of that
// handedness expects it.
void expect_arrows(Handedness handedness, uint32_t size,
                   const std::function<Vector(uint32_t face, uint32_t i, uint32_t j)>& texel);

// A file of KTX 2.0, taken apart.
struct Ktx2 {
  struct Level {
    uint64_t offset = 0, bytes = 0, unpacked_bytes = 0;
  };
  std::string file;
  // vkFormat, typeSize, pixelWidth, pixelHeight, pixelDepth, layerCount, faceCount, levelCount,
  // supercompressionScheme
  std::array<uint32_t, 9> header{};
  uint32_t descriptor_at = 0, descriptor_bytes = 0, keys_at = 0, keys_bytes = 0;
  uint64_t global_at = 0, global_bytes = 0;
  std::vector<Level> levels;
  std::vector<uint32_t> descriptor;  // as words
  std::vector<std::pair<std::string, std::string>>
      entries;  // values without their last NUL, in the file's order

  std::string value(const std::string& key) const;
  // R, G and B of a texel.
  Vector texel(size_t level, uint32_t face, uint32_t i, uint32_t j) const;
};

// Fails the test where the bytes are not a file of KTX 2.0.
Ktx2 parse_ktx2(const std::string& path);

}  // namespace candela
