#include "client/environment/cube_lookup.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "client/environment/cube_faces.h"

namespace candela {
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
