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

// R, G and B of a texel.
std::array<float, 3> texel_rgb(const std::byte* texel, CubeFormat format);

// The format of pictures of an environment: kRgba32f if its texels are floats, else kRgba16f, which holds
// both other formats exactly.
ImageFormat picture_format(const BakedEnvironment& environment);
// Writes a pixel of that format, with an alpha of 1.
void write_pixel(const std::array<float, 3>& rgb, ImageFormat format, std::byte* out);

// Row `j` of a world's face of level `level`, with its columns reversed if `mirrored`. The texels are in the
// environment's format, or in that of its pictures.
void copy_row(const BakedEnvironment& environment, size_t level, FileFace face, uint32_t j, std::byte* out);
void copy_row_as_pixels(const BakedEnvironment& environment, size_t level, FileFace face, uint32_t j,
                        std::byte* out);

// `face` as it is in a file of the environment's handedness. Fails like make_image().
absl::StatusOr<Image> face_picture(const BakedEnvironment& environment, size_t level, uint32_t face);

// Bilinear lookups in a level of a cube map, without seams (docs/environments.md section 2).
//
// Reads the environment's texels where they are; the environment must outlive it.
class CubeLookup {
 public:
  CubeLookup(const BakedEnvironment& environment, size_t level)
      : level_(environment.levels[level]), format_(environment.format) {}

  // R, G and B in the world's direction d, which need not have length 1 but must not be 0.
  std::array<float, 3> at(const std::array<float, 3>& d) const;

 private:
  using Rgb = std::array<float, 3>;
  Rgb texel(uint32_t face, int i, int j) const;
  // Texel (i, j), of which one or both may be -1 or the size: beyond an edge or a corner.
  Rgb tap(uint32_t face, int i, int j) const;
  // The same beyond one edge: the neighbour's texel.
  Rgb beyond_edge(uint32_t face, int i, int j) const;

  const BakedLevel& level_;
  CubeFormat format_;
};

}  // namespace candela
