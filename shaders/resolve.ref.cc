// Twin of resolve.comp: composite, exposure, tone curve and transfer.
#include <algorithm>
#include <cmath>

#include "shaders/bilinear.h"
#include "shaders/reference.h"

namespace candela::reference {

namespace {

Rgb multiply(const double (&m)[3][3], const Rgb& v) {
  Rgb out{};
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 3; ++c) out[r] += m[r][c] * v[c];
  }
  return out;
}

Rgb aces_hill(const Rgb& x) {
  static constexpr double kInput[3][3] = {
      {0.59719, 0.35458, 0.04823}, {0.07600, 0.90834, 0.01566}, {0.02840, 0.13383, 0.83777}};
  static constexpr double kOutput[3][3] = {
      {1.60475, -0.53108, -0.07367}, {-0.10208, 1.10813, -0.00605}, {-0.00327, -0.07276, 1.07602}};
  Rgb v = multiply(kInput, x);
  for (double& c : v) c = (c * (c + 0.0245786) - 0.000090537) / (c * (0.983729 * c + 0.4329510) + 0.238081);
  return multiply(kOutput, v);
}

}  // namespace

Rgb tone_curve(uint curve, const Rgb& x) {
  Rgb y = x;
  if (curve == shader::CURVE_REINHARD) {
    for (double& c : y) c = c / (1.0 + c);
  } else if (curve == shader::CURVE_ACES_NARKOWICZ) {
    for (double& c : y) c = c * (2.51 * c + 0.03) / (c * (2.43 * c + 0.59) + 0.14);
  } else if (curve == shader::CURVE_ACES_HILL) {
    y = aces_hill(x);
  }
  for (double& c : y) c = std::clamp(c, 0.0, 1.0);
  return y;
}

double transfer(uint transfer, double y) {
  if (transfer == shader::TRANSFER_SRGB)
    return y <= 0.0031308 ? 12.92 * y : 1.055 * std::pow(y, 1 / 2.4) - 0.055;
  if (transfer == shader::TRANSFER_GAMMA22) return std::pow(y, 1 / 2.2);
  return y;
}

std::vector<std::array<double, 4>> resolve(const Scene& scene, const Level& bloom, uint32_t level_count,
                                           const ResolveParams& params) {
  std::vector<std::array<double, 4>> image(scene.texels.size());
  for (uint32_t y = 0; y < scene.height; ++y) {
    for (uint32_t x = 0; x < scene.width; ++x) {
      const size_t at = size_t{y} * scene.width + x;
      const auto& s = scene.texels[at];
      Rgb c = {s[0], s[1], s[2]};
      if (params.bloom_intensity > 0.0) {
        const Rgb b = bilinear(bloom, (x + 0.5) / 2.0 - 0.5, (y + 0.5) / 2.0 - 0.5);
        for (int n = 0; n < 3; ++n) c[n] += params.bloom_intensity * b[n] / level_count;
      }
      for (double& v : c) v = params.exposure * std::max(v, 0.0);
      c = tone_curve(params.curve, c);
      for (int n = 0; n < 3; ++n) image[at][n] = params.encode ? transfer(params.transfer, c[n]) : c[n];
      image[at][3] = s[3];
    }
  }
  return image;
}

}  // namespace candela::reference
