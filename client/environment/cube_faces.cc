#include "client/environment/cube_faces.h"

#include <half.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <cstring>

#include "proto/candela/v1/pixel_size.h"

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

namespace {

template <typename A, typename B>
auto dot(const A& a, const B& b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

// The face that the vector points at: that of its largest component.
template <typename T>
uint32_t face_of(const std::array<T, 3>& v) {
  size_t axis = std::abs(v[1]) > std::abs(v[0]) ? 1 : 0;
  if (std::abs(v[2]) > std::abs(v[axis])) axis = 2;
  return static_cast<uint32_t>(2 * axis + (v[axis] < 0));
}

}  // namespace

CubeLookup::Rgb CubeLookup::texel(uint32_t face, int i, int j) const {
  const auto size = static_cast<size_t>(level_.size);
  const size_t index = (face * size + static_cast<size_t>(j)) * size + static_cast<size_t>(i);
  return texel_rgb(level_.texels.data() + index * bytes_per_texel(format_), format_);
}

CubeLookup::Rgb CubeLookup::beyond_edge(uint32_t face, int i, int j) const {
  // In units of half a texel the face lies `size` from the centre. A tap's centre is half a texel beyond the
  // edge; folded around the edge it lies in the neighbour's plane, half a texel below the edge.
  const int size = static_cast<int>(level_.size);
  const FaceAxes& axes = face_axes(face);
  int right = 2 * i + 1 - size, down = 2 * j + 1 - size;
  right = std::clamp(right, -size, size);
  down = std::clamp(down, -size, size);
  std::array<int, 3> v;
  for (size_t k = 0; k < 3; ++k) {
    v[k] = (size - 1) * axes.out[k] + right * axes.right[k] + down * axes.down[k];
  }
  const uint32_t neighbour = face_of(v);
  const FaceAxes& other = face_axes(neighbour);
  return texel(neighbour, (dot(v, other.right) + size - 1) / 2, (dot(v, other.down) + size - 1) / 2);
}

CubeLookup::Rgb CubeLookup::tap(uint32_t face, int i, int j) const {
  const int last = static_cast<int>(level_.size) - 1;
  const int inner_i = std::clamp(i, 0, last), inner_j = std::clamp(j, 0, last);
  if (i == inner_i && j == inner_j) return texel(face, i, j);
  if (i == inner_i || j == inner_j) return beyond_edge(face, i, j);
  const Rgb a = texel(face, inner_i, inner_j), b = beyond_edge(face, i, inner_j),
            c = beyond_edge(face, inner_i, j);
  Rgb mean;
  for (size_t k = 0; k < 3; ++k) mean[k] = (a[k] + b[k] + c[k]) / 3;
  return mean;
}

std::array<float, 3> CubeLookup::at(const std::array<float, 3>& d) const {
  const uint32_t face = face_of(d);
  const FaceAxes& axes = face_axes(face);
  const float depth = dot(d, axes.out), half_size = 0.5f * static_cast<float>(level_.size);
  const float x = (dot(d, axes.right) / depth + 1) * half_size - 0.5f;
  const float y = (dot(d, axes.down) / depth + 1) * half_size - 0.5f;
  const float x0 = std::floor(x), y0 = std::floor(y), fx = x - x0, fy = y - y0;
  const int i = static_cast<int>(x0), j = static_cast<int>(y0);
  const Rgb a = tap(face, i, j), b = tap(face, i + 1, j), c = tap(face, i, j + 1),
            e = tap(face, i + 1, j + 1);
  Rgb out;
  for (size_t k = 0; k < 3; ++k) {
    out[k] = (1 - fy) * ((1 - fx) * a[k] + fx * b[k]) + fy * ((1 - fx) * c[k] + fx * e[k]);
  }
  return out;
}

}  // namespace candela
