// The faces of cube maps: which direction a texel shows, and how the faces in files differ from the world's.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "absl/status/statusor.h"
#include "client/environment/baked_environment.h"
#include "client/image/image.h"

namespace candela {

// With s to the right and t down, each -1 .. 1, a face shows the direction out + s * right + t * down.
struct FaceAxes {
  std::array<int, 3> out, right, down;
};
const FaceAxes& face_axes(uint32_t face);

// The world's face that is stored as `face` in a cube map of a file, and whether its columns are reversed.
struct FileFace {
  uint32_t world_face = 0;
  bool mirrored = false;
};
constexpr FileFace file_face(uint32_t face, Handedness handedness) {
  if (handedness == Handedness::kRight) return {face, false};
  return {face < 2 ? 1 - face : face, true};
}

// Row `j` of a world's face of level `level`, with its columns reversed if `mirrored`. The texels are in the
// environment's format, or halves with an alpha of 1, which hold both formats exactly.
void copy_row(const BakedEnvironment& environment, size_t level, FileFace face, uint32_t j, std::byte* out);
void copy_row_as_halves(const BakedEnvironment& environment, size_t level, FileFace face, uint32_t j,
                        std::byte* out);

// `face` as it is in a file of the environment's handedness; kRgba16f. Fails like make_image().
absl::StatusOr<Image> face_picture(const BakedEnvironment& environment, size_t level, uint32_t face);

}  // namespace candela
