// Twin of cube_specular.comp: the environment blurred by GGX. The shader walks the chain, the twin sums over
// the whole panorama.
#include <algorithm>
#include <cmath>

#include "shaders/environment/environment.h"

namespace candela::reference {

namespace {

double ggx(double h, double alpha) {
  const double root = h * h * (alpha * alpha - 1.0) + 1.0;
  return alpha * alpha / (kPi * root * root);
}

// The weight of light that comes at an angle of cosine c to the reflection.
double lobe(double c, double alpha) { return std::max(c, 0.0) * ggx(std::sqrt((1.0 + c) / 2.0), alpha); }

// A panorama without texels whose texels would be the points x points parts of the texels of `panorama`.
Scene finer(const Scene& panorama, uint32_t points) {
  return {panorama.width * points, panorama.height * points, {}, {}};
}

// sin(lon + shift) at the columns' centres.
std::vector<double> sines_of_columns(uint32_t width, double shift) {
  std::vector<double> sines;
  for (uint32_t x = 0; x < width; ++x)
    sines.push_back(std::sin(2.0 * kPi * ((x + 0.5) / width - 0.5) + shift));
  return sines;
}

}  // namespace

uint32_t specular_levels(uint32_t size) {
  uint32_t levels = 1;
  for (; size > 16; size /= 2) ++levels;
  return levels;
}

double specular_roughness(uint32_t level, uint32_t levels, RoughnessMapping mapping) {
  if (levels == 1) return 0.0;
  const double part = static_cast<double>(level) / (levels - 1.0);
  return mapping == RoughnessMapping::kLinear ? part : 1.0 - std::sqrt(1.0 - part);
}

Rgb specular_at(const Scene& panorama, const Direction& n, double roughness) {
  const double alpha = roughness * roughness;
  const Direction axis = normalized(n);
  const double texel = std::max(2.0 * kPi / panorama.width, kPi / panorama.height);
  const double points = std::max(1.0, std::ceil(4.0 * texel / (2.574 * alpha)));
  const Scene grid = finer(panorama, static_cast<uint32_t>(points));
  const std::vector<double> sines = sines_of_columns(grid.width, 0.0);
  const std::vector<double> cosines = sines_of_columns(grid.width, kPi / 2.0);
  Rgb sum{};
  double weights = 0.0;
  for (uint32_t y = 0; y < grid.height; ++y) {
    const double v = (y + 0.5) / grid.height;
    const Direction ahead = panorama_direction(0.5, v);  // (0, sin lat, -cos lat)
    const double solid_angle = panorama_solid_angle(grid, y);
    for (uint32_t x = 0; x < grid.width; ++x) {
      const Direction l = {-ahead[2] * sines[x], ahead[1], ahead[2] * cosines[x]};
      const double c = std::min(dot(axis, l), 1.0);
      if (c <= 0.0) continue;
      const double weight = lobe(c, alpha) * solid_angle;
      weights += weight;
      if (grid.width == panorama.width) {
        accumulate(&sum, panorama.at(x, y), weight);
      } else {
        accumulate(&sum, panorama_at(panorama, (x + 0.5) / grid.width, v), weight);
      }
    }
    row_done();
  }
  for (double& color : sum) color /= weights;
  return sum;
}

}  // namespace candela::reference
