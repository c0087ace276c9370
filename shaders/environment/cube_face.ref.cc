// Twin of cube_face.comp: level 0 of a cube map from the panorama.
#include <cmath>

#include "shaders/environment/environment.h"

namespace candela::reference {

namespace {

// The solid angle between the centre of a face, (s, 0), (0, t) and (s, t).
double corner_area(double s, double t) { return std::atan2(s * t, std::sqrt(s * s + t * t + 1.0)); }

}  // namespace

Direction cube_direction(uint32_t face, uint32_t i, uint32_t j, uint32_t size) {
  return normalized(cube_point({face, 2.0 * (i + 0.5) / size - 1.0, 2.0 * (j + 0.5) / size - 1.0}));
}

double cube_solid_angle(uint32_t i, uint32_t j, uint32_t size) {
  const double s0 = 2.0 * i / size - 1.0;
  const double t0 = 2.0 * j / size - 1.0;
  const double s1 = 2.0 * (i + 1.0) / size - 1.0;
  const double t1 = 2.0 * (j + 1.0) / size - 1.0;
  return corner_area(s1, t1) - corner_area(s0, t1) - corner_area(s1, t0) + corner_area(s0, t0);
}

uint32_t cube_default_size(uint32_t panorama_width) {
  uint32_t size = 16;
  while (size < 2048 && uint64_t{size} * 4 < panorama_width) size *= 2;
  return size;
}

CubeLevel cube_face(const Scene& panorama, uint32_t size, uint32_t samples, double rotation_deg) {
  CubeLevel out{size, {}};
  out.texels.reserve(size_t{6} * size * size);
  const double weight = 1.0 / (static_cast<double>(samples) * samples);
  for (uint32_t row = 0; row < 6 * size; ++row) {
    const uint32_t face = row / size;
    const uint32_t j = row % size;
    for (uint32_t i = 0; i < size; ++i) {
      Rgb& mean = out.texels.emplace_back();
      for (uint32_t k = 0; k < samples * samples; ++k) {
        // The texels of a cube `samples` times as fine have their centres at the sub-texels' centres.
        const Direction d =
            cube_direction(face, i * samples + k % samples, j * samples + k / samples, size * samples);
        accumulate(&mean, panorama_at(panorama, turned_back(d, rotation_deg)), weight);
      }
    }
    row_done();
  }
  return out;
}

}  // namespace candela::reference
