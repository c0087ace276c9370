// Panoramas and directions for the tests of the references of environments.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <random>
#include <vector>

#include "shaders/environment/environment.h"

namespace candela {

using reference::kPi;

inline double dot3(const reference::Direction& a, const reference::Direction& b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

inline reference::Direction unit(const reference::Direction& d) {
  const double length = std::sqrt(dot3(d, d));
  return {d[0] / length, d[1] / length, d[2] / length};
}

inline double difference(const reference::Rgb& a, const reference::Rgb& b) {
  return std::max({std::abs(a[0] - b[0]), std::abs(a[1] - b[1]), std::abs(a[2] - b[2])});
}

// A panorama of `light` in the directions of its texels.
inline reference::Scene panorama_of(uint32_t width, uint32_t height,
                                    const std::function<reference::Rgb(const reference::Direction&)>& light) {
  reference::Scene scene{width, height, {}, {}};
  for (uint32_t y = 0; y < height; ++y) {
    for (uint32_t x = 0; x < width; ++x) {
      const reference::Rgb c = light(reference::panorama_direction((x + 0.5) / width, (y + 0.5) / height));
      scene.texels.push_back(
          {static_cast<float>(c[0]), static_cast<float>(c[1]), static_cast<float>(c[2]), 1.0f});
    }
  }
  return scene;
}

class Random {
 public:
  explicit Random(uint32_t seed) : engine_(seed) {}
  // 0 .. 1.
  double number() { return static_cast<double>(engine_()) / 4294967296.0; }
  reference::Direction direction() {
    for (;;) {
      const reference::Direction d = {2 * number() - 1, 2 * number() - 1, 2 * number() - 1};
      if (dot3(d, d) > 0.01 && dot3(d, d) < 1.0) return unit(d);
    }
  }
  reference::Rgb color() { return {number(), number(), number()}; }

 private:
  std::mt19937 engine_;
};

inline reference::Scene random_panorama(uint32_t width, uint32_t height, uint32_t seed) {
  Random random(seed);
  return panorama_of(width, height, [&](const reference::Direction&) { return random.color(); });
}

// The panorama whose texel (x, y) is the texel (x + columns, y) of `scene`.
inline reference::Scene shifted(const reference::Scene& scene, uint32_t columns) {
  reference::Scene out = scene;
  for (uint32_t y = 0; y < scene.height; ++y) {
    for (uint32_t x = 0; x < scene.width; ++x) {
      out.texels[size_t{y} * scene.width + x] = scene.at((x + columns) % scene.width, y);
    }
  }
  return out;
}

// Panoramas of every kind of size.
inline constexpr uint32_t kLookupSizes[][2] = {{1, 1}, {2, 1}, {3, 1}, {1, 4},
                                               {3, 2}, {7, 5}, {8, 4}, {5, 9}};

struct CubeTexel {
  uint32_t face, i, j;
};

// Every texel of a level.
inline std::vector<CubeTexel> texels_of(uint32_t size) {
  std::vector<CubeTexel> texels;
  for (uint32_t n = 0; n < 6 * size * size; ++n)
    texels.push_back({n / (size * size), n % size, n / size % size});
  return texels;
}

// A level whose texels are `light` in the directions of their centres.
inline reference::CubeLevel cube_of(uint32_t size,
                                    const std::function<reference::Rgb(const reference::Direction&)>& light) {
  reference::CubeLevel level{size, {}};
  for (const auto& [face, i, j] : texels_of(size))
    level.texels.push_back(light(reference::cube_direction(face, i, j, size)));
  return level;
}

// The sum over a level, weighted by solid angles.
inline reference::Rgb integral_of(const reference::CubeLevel& level) {
  reference::Rgb sum{};
  for (const auto& [face, i, j] : texels_of(level.size)) {
    const double weight = reference::cube_solid_angle(i, j, level.size);
    for (size_t n = 0; n < 3; ++n) sum[n] += weight * level.at(face, i, j)[n];
  }
  return sum;
}

}  // namespace candela
