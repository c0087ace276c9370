#include "server/render/environment/environment.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <numbers>

#include "server/vulkan/pipeline.h"
#include "shaders/environment/environment_params.h"

namespace candela {

static_assert(PipelineCache::kWriteAlignment == 16 * kCubeTexelBytes);

uint32_t default_cube_size(uint32_t panorama_width) {
  return std::clamp(std::bit_ceil((panorama_width + 3) / 4), kMinCubeSize, 2048u);
}

// Smaller cubes have too few specular levels for a rough sphere.
uint32_t view_cube_size(uint32_t panorama_width) { return std::max(default_cube_size(panorama_width), 128u); }

uint32_t cube_samples(uint32_t panorama_width, uint32_t size, uint32_t samples) {
  return samples * std::max(1u, (panorama_width + 4 * size - 1) / (4 * size));
}

uint32_t chain_levels(uint32_t size) { return static_cast<uint32_t>(std::bit_width(size)); }

uint32_t specular_levels(uint32_t size) { return chain_levels(size) - chain_levels(kMinCubeSize) + 1; }

double specular_roughness(uint32_t level, uint32_t levels, RoughnessMapping mapping) {
  if (levels < 2) return 0;
  const double part = static_cast<double>(level) / (levels - 1);
  return mapping == RoughnessMapping::kLinear ? part : 1 - std::sqrt(1 - part);
}

uint64_t CubeLevels::face_texels(uint32_t level) const {
  const uint64_t side = size_of(level) + 2;
  return side * side;
}

uint64_t CubeLevels::start(uint32_t level) const { return CUBE_LEVEL_START(size, size_of(level), level); }

uint64_t cube_bytes(uint32_t size, uint32_t levels) {
  const CubeLevels cube{{}, size, levels};
  return (cube.start(levels - 1) + cube.level_texels(levels - 1)) * kCubeTexelBytes;
}

uint64_t chain_bytes(uint32_t size) { return cube_bytes(size, chain_levels(size)); }

uint64_t specular_bytes(uint32_t size) {
  const uint32_t levels = specular_levels(size);
  return levels > 1 ? cube_bytes(size / 2, levels - 1) : 0;
}

namespace {

constexpr double kPi = std::numbers::pi;

// A row's sums of R, G or B with the column factors 1, sin lon, cos lon, sin 2 lon, cos 2 lon.
struct RowSums {
  double plain = 0, sin1 = 0, cos1 = 0, sin2 = 0, cos2 = 0;
};

RowSums row_sums(const float* parts, size_t component) {
  RowSums sums;
  for (uint32_t part = 0; part < shader::SH_PARTS; ++part, parts += 16) {
    sums.plain += parts[component];
    sums.sin1 += parts[3 + component];
    sums.cos1 += parts[6 + component];
    sums.sin2 += parts[9 + component];
    sums.cos2 += parts[12 + component];
  }
  return sums;
}

// Integrals over the latitudes of a row, each with the cos lat of the solid angle.
struct RowFactors {
  double c;    // cos
  double sc;   // sin cos
  double cc;   // cos^2
  double ccs;  // cos^2 sin
  double ccc;  // cos^3
  double ssc;  // sin^2 cos
};

RowFactors row_factors(uint32_t y, uint32_t height) {
  const double top = kPi * (0.5 - static_cast<double>(y) / height);
  const double bottom = kPi * (0.5 - static_cast<double>(y + 1) / height);
  const auto between = [&](auto antiderivative) { return antiderivative(top) - antiderivative(bottom); };
  const auto cube = [](double x) { return x * x * x; };
  RowFactors f{};
  f.c = between([](double a) { return std::sin(a); });
  f.sc = between([](double a) { return 0.5 * std::sin(a) * std::sin(a); });
  f.cc = between([](double a) { return 0.5 * a + 0.25 * std::sin(2 * a); });
  f.ccs = between([&](double a) { return -cube(std::cos(a)) / 3; });
  f.ssc = between([&](double a) { return cube(std::sin(a)) / 3; });
  f.ccc = f.c - f.ssc;
  return f;
}

}  // namespace

const std::array<double, 9> kHarmonicFactors = {
    std::sqrt(1 / (4 * kPi)),  std::sqrt(3 / (4 * kPi)),  std::sqrt(3 / (4 * kPi)),
    std::sqrt(3 / (4 * kPi)),  std::sqrt(15 / (4 * kPi)), std::sqrt(15 / (4 * kPi)),
    std::sqrt(5 / (16 * kPi)), std::sqrt(15 / (4 * kPi)), std::sqrt(15 / (16 * kPi))};

std::vector<std::array<float, 4>> column_factors(uint32_t width) {
  std::vector<std::array<float, 4>> factors(width);
  for (uint32_t x = 0; x < width; ++x) {
    const double a = 2 * kPi * (static_cast<double>(x) / width - 0.5);
    const double b = 2 * kPi * (static_cast<double>(x + 1) / width - 0.5);
    factors[x] = {static_cast<float>(std::cos(a) - std::cos(b)),
                  static_cast<float>(std::sin(b) - std::sin(a)),
                  static_cast<float>((std::cos(2 * a) - std::cos(2 * b)) / 2),
                  static_cast<float>((std::sin(2 * b) - std::sin(2 * a)) / 2)};
  }
  return factors;
}

// The direction is (sin lon cos lat, sin lat, -cos lon cos lat), so z^2 has cos^2 lon = (1 + cos 2 lon) / 2
// and x z has -sin 2 lon / 2.
Harmonics radiance_of(std::span<const float> sums, uint32_t width, uint32_t height) {
  Harmonics radiance{};
  for (uint32_t y = 0; y < height; ++y) {
    const RowFactors f = row_factors(y, height);
    for (size_t k = 0; k < 3; ++k) {
      const RowSums s = row_sums(sums.data() + size_t{y} * shader::SH_PARTS * 16, k);
      const double plain = s.plain * 2 * kPi / width;
      radiance[0][k] += f.c * plain;
      radiance[1][k] += f.sc * plain;
      radiance[2][k] += -f.cc * s.cos1;
      radiance[3][k] += f.cc * s.sin1;
      radiance[4][k] += f.ccs * s.sin1;
      radiance[5][k] += -f.ccs * s.cos1;
      radiance[6][k] += 1.5 * f.ccc * (plain + s.cos2) - f.c * plain;
      radiance[7][k] += -0.5 * f.ccc * s.sin2;
      radiance[8][k] += 0.5 * f.ccc * (plain - s.cos2) - f.ssc * plain;
    }
  }
  for (size_t i = 0; i < radiance.size(); ++i) {
    for (double& value : radiance[i]) value *= kHarmonicFactors[i];
  }
  return radiance;
}

// Light from (x, y, z) then comes from x' = x cos + z sin, y' = y, z' = z cos - x sin, and the coefficients
// are polynomials of these.
Harmonics turned(const Harmonics& radiance, double rotation_deg) {
  const double angle = rotation_deg * kPi / 180;
  const double c1 = std::cos(angle), s1 = std::sin(angle), c2 = std::cos(2 * angle), s2 = std::sin(2 * angle);
  const double r3 = std::sqrt(3.0);
  Harmonics out = radiance;
  for (size_t k = 0; k < 3; ++k) {
    const auto in = [&](size_t i) { return radiance[i][k]; };
    out[3][k] = c1 * in(3) + s1 * in(2);
    out[2][k] = c1 * in(2) - s1 * in(3);
    out[4][k] = c1 * in(4) + s1 * in(5);
    out[5][k] = c1 * in(5) - s1 * in(4);
    // (2,0) and (2,2) are sums of e, which belongs to (z^2 - x^2) / 2 as f does to x z, and of one that
    // belongs to 1 - 3 y^2, which stays.
    const double e = (r3 * in(6) - in(8)) / 2;
    const double around = (in(6) + r3 * in(8)) / 2;
    const double f = in(7);
    const double e_turned = e * c2 - f * s2;
    out[7][k] = f * c2 + e * s2;
    out[6][k] = (r3 * e_turned + around) / 2;
    out[8][k] = (r3 * around - e_turned) / 2;
  }
  return out;
}

Harmonics irradiance_of(const Harmonics& radiance) {
  Harmonics out = radiance;
  for (size_t i = 0; i < out.size(); ++i) {
    const double factor = i == 0 ? kPi : i < 4 ? 2 * kPi / 3 : kPi / 4;
    for (double& value : out[i]) value *= factor;
  }
  return out;
}

}  // namespace candela
