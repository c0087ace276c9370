#include "client/environment/cube_faces.h"

#include <half.h>

#include <cstring>

#include "proto/candela/v1/rgb9e5.h"

namespace candela {
namespace {

const std::byte* row_of(const BakedEnvironment& environment, const BakedLevel& level, uint32_t world_face,
                        uint32_t j) {
  return level.texels.data() +
         (size_t{world_face} * level.size + j) * level.size * bytes_per_texel(environment.format);
}

}  // namespace

std::array<float, 3> texel_rgb(const std::byte* texel, CubeFormat format) {
  std::array<float, 3> rgb{};
  if (format == CubeFormat::kRgba32f) {
    std::memcpy(rgb.data(), texel, sizeof rgb);
  } else if (format == CubeFormat::kRgba16f) {
    uint16_t half[3];
    std::memcpy(half, texel, sizeof half);
    for (size_t c = 0; c < 3; ++c) rgb[c] = imath_half_to_float(half[c]);
  } else {
    uint32_t word = 0;
    std::memcpy(&word, texel, sizeof word);
    rgb = v1::unpack_rgb9e5(word);
  }
  return rgb;
}

ImageFormat picture_format(const BakedEnvironment& environment) {
  return environment.format == CubeFormat::kRgba32f ? ImageFormat::kRgba32f : ImageFormat::kRgba16f;
}

void write_pixel(const std::array<float, 3>& rgb, ImageFormat format, std::byte* out) {
  if (format == ImageFormat::kRgba32f) {
    const float pixel[4] = {rgb[0], rgb[1], rgb[2], 1};
    std::memcpy(out, pixel, sizeof pixel);
    return;
  }
  constexpr uint16_t kHalfOne = 0x3c00;
  const uint16_t pixel[4] = {imath_float_to_half(rgb[0]), imath_float_to_half(rgb[1]),
                             imath_float_to_half(rgb[2]), kHalfOne};
  std::memcpy(out, pixel, sizeof pixel);
}

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

void copy_row_as_pixels(const BakedEnvironment& environment, size_t level, FileFace face, uint32_t j,
                        std::byte* out) {
  const BakedLevel& from = environment.levels[level];
  const uint32_t size = from.size, bytes = bytes_per_texel(environment.format);
  const ImageFormat format = picture_format(environment);
  const std::byte* row = row_of(environment, from, face.world_face, j);
  for (uint32_t i = 0; i < size; ++i) {
    const uint32_t column = face.mirrored ? size - 1 - i : i;
    write_pixel(texel_rgb(row + column * bytes, environment.format), format,
                out + size_t{i} * bytes_per_pixel(format));
  }
}

absl::StatusOr<Image> face_picture(const BakedEnvironment& environment, size_t level, uint32_t face) {
  const uint32_t size = environment.levels[level].size;
  absl::StatusOr<Image> image = make_image(size, size, picture_format(environment));
  if (!image.ok()) return image;
  const FileFace from = file_face(face, environment.handedness);
  for (uint32_t j = 0; j < size; ++j) {
    copy_row_as_pixels(environment, level, from, j, image->pixels.data() + j * image->row_bytes());
  }
  return image;
}

}  // namespace candela
