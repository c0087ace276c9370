#include "client/environment/cube_faces.h"

#include <half.h>

#include <cstring>

#include "proto/candela/v1/rgb9e5.h"

namespace candela {
namespace {

constexpr uint16_t kHalfOne = 0x3c00;

// The halves of one texel in either format.
std::array<uint16_t, 4> halves_of(const std::byte* texel, CubeFormat format) {
  std::array<uint16_t, 4> half{};
  if (format == CubeFormat::kRgba16f) {
    std::memcpy(half.data(), texel, 6);
  } else {
    uint32_t word = 0;
    std::memcpy(&word, texel, 4);
    const std::array<float, 3> rgb = v1::unpack_rgb9e5(word);
    for (size_t c = 0; c < 3; ++c) half[c] = imath_float_to_half(rgb[c]);
  }
  half[3] = kHalfOne;
  return half;
}

const std::byte* row_of(const BakedEnvironment& environment, const BakedLevel& level, uint32_t world_face,
                        uint32_t j) {
  return level.texels.data() +
         (size_t{world_face} * level.size + j) * level.size * bytes_per_texel(environment.format);
}

}  // namespace

const FaceAxes& face_axes(uint32_t face) {
  static constexpr FaceAxes kAxes[kCubeFaces] = {
      {{1, 0, 0}, {0, 0, -1}, {0, -1, 0}}, {{-1, 0, 0}, {0, 0, 1}, {0, -1, 0}},
      {{0, 1, 0}, {1, 0, 0}, {0, 0, 1}},   {{0, -1, 0}, {1, 0, 0}, {0, 0, -1}},
      {{0, 0, 1}, {1, 0, 0}, {0, -1, 0}},  {{0, 0, -1}, {-1, 0, 0}, {0, -1, 0}}};
  return kAxes[face];
}

void copy_row(const BakedEnvironment& environment, size_t level, FileFace face, uint32_t j, std::byte* out) {
  const BakedLevel& from = environment.levels[level];
  const uint32_t size = from.size, bytes = bytes_per_texel(environment.format);
  const std::byte* row = row_of(environment, from, face.world_face, j);
  if (!face.mirrored) {
    std::memcpy(out, row, size_t{size} * bytes);
    return;
  }
  for (uint32_t i = 0; i < size; ++i) std::memcpy(out + i * bytes, row + (size - 1 - i) * bytes, bytes);
}

void copy_row_as_halves(const BakedEnvironment& environment, size_t level, FileFace face, uint32_t j,
                        std::byte* out) {
  const BakedLevel& from = environment.levels[level];
  const uint32_t size = from.size, bytes = bytes_per_texel(environment.format);
  const std::byte* row = row_of(environment, from, face.world_face, j);
  for (uint32_t i = 0; i < size; ++i) {
    const uint32_t column = face.mirrored ? size - 1 - i : i;
    const std::array<uint16_t, 4> half = halves_of(row + column * bytes, environment.format);
    std::memcpy(out + i * sizeof half, half.data(), sizeof half);
  }
}

absl::StatusOr<Image> face_picture(const BakedEnvironment& environment, size_t level, uint32_t face) {
  const uint32_t size = environment.levels[level].size;
  absl::StatusOr<Image> image = make_image(size, size, ImageFormat::kRgba16f);
  if (!image.ok()) return image;
  const FileFace from = file_face(face, environment.handedness);
  for (uint32_t j = 0; j < size; ++j) {
    copy_row_as_halves(environment, level, from, j, image->pixels.data() + j * image->row_bytes());
  }
  return image;
}

}  // namespace candela
