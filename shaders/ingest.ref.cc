// Twin of ingest.comp: ingest and metering.
#include <half.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <map>

#include "shaders/reference.h"

namespace candela::reference {

namespace {

std::array<float, 4> unpack(const std::byte* texel, uint pixels) {
  if (pixels == shader::PIXELS_RGBA32F) {
    std::array<float, 4> c;
    std::memcpy(c.data(), texel, sizeof c);
    return c;
  }
  if (pixels == shader::PIXELS_RGBA16F) {
    std::array<uint16_t, 4> bits;
    std::memcpy(bits.data(), texel, sizeof bits);
    std::array<float, 4> c;
    for (int i = 0; i < 4; ++i) c[i] = imath_half_to_float(bits[i]);
    return c;
  }
  uint32_t word;
  std::memcpy(&word, texel, sizeof word);
  const int exponent = static_cast<int>(word >> 27) - 15 - 9;
  std::array<float, 4> c;
  for (int i = 0; i < 3; ++i) c[i] = static_cast<float>(std::ldexp((word >> (9 * i)) & 511, exponent));
  c[3] = 1.0f;
  return c;
}

// The metered luminance. It is defined in float32: where components of both signs cancel, no other arithmetic
// gives the same.
float luminance32(const std::array<float, 4>& c) {
  return std::max(0.0f, (0.2126f * c[0] + 0.7152f * c[1]) + 0.0722f * c[2]);
}

float scrub_alpha(float x) { return std::isnan(x) ? 0.0f : std::clamp(x, -kHalfMax, kHalfMax); }
float clamp_light(float x) { return std::clamp(x, -shader::MAX_LIGHT, shader::MAX_LIGHT); }
float scrub_light(float x) { return std::isfinite(x) ? clamp_light(x) : scrub_alpha(x); }

// The nearest half. What is beyond the largest one stays.
float to_half(float x) { return std::fabs(x) > kHalfMax ? x : imath_half_to_float(imath_float_to_half(x)); }

// Alpha in 255 steps.
uint32_t alpha_code(const std::array<float, 4>& texel) {
  return static_cast<uint32_t>(std::lround(255.0 * std::clamp<double>(texel[3], 0.0, 1.0)));
}

// How a scene's alphas weigh.
struct Coverage {
  bool any = false;    // some code is above 0; without one they do not count
  bool parts = false;  // some code is between 0 and 255; then a weight of 1 stands as 255

  Coverage(const Scene& scene, const MeterParams& params) {
    if (!params.ignore_absent) return;
    for (const auto& texel : scene.texels) {
      const uint32_t code = alpha_code(texel);
      any |= code > 0;
      parts |= code > 0 && code < 255;
    }
  }

  uint32_t weight(uint32_t whole, uint weights, uint32_t code) const {
    if (!any) return whole;
    if (weights != shader::WEIGHTS_CENTER) return whole * (parts ? code : code / 255);
    return static_cast<uint32_t>(std::lround(whole * code / 255.0));
  }
};

}  // namespace

Scene ingest(std::span<const std::byte> wire, size_t stride_bytes, uint32_t width, uint32_t height,
             uint pixels, const std::optional<Matrix>& matrix, Rounding rounding, BadCounts* counts) {
  const size_t texel_bytes = pixels == shader::PIXELS_RGBA32F ? 16 : pixels == shader::PIXELS_RGBA16F ? 8 : 4;
  Scene scene{width, height, {}, {}};
  const size_t texels = size_t{width} * height;
  scene.texels.reserve(texels);
  *counts = {};
  for (size_t i = 0; i < texels; ++i) {
    std::array<float, 4> c = unpack(wire.data() + i / width * stride_bytes + i % width * texel_bytes, pixels);
    for (int k = 0; k < 3; ++k) {
      if (std::isnan(c[k])) ++counts->nan;
      if (std::isinf(c[k])) ++counts->infinite;
      if (c[k] < 0.0f) ++counts->negative;
      const bool clamped = std::isfinite(c[k]) && std::fabs(c[k]) > shader::MAX_LIGHT;
      counts->clamped += clamped;
      if ((clamped || !std::isfinite(c[k])) && !counts->first_bad_texel) counts->first_bad_texel = i;
    }
    for (int k = 0; k < 3; ++k) c[k] = scrub_light(c[k]);
    c[3] = scrub_alpha(c[3]);
    if (c[0] == 0.0f && c[1] == 0.0f && c[2] == 0.0f && c[3] <= 0.0f) {
      scene.absent.resize(texels);
      scene.absent[i] = true;
    }
    if (matrix) {
      // The scene is defined in float32, so that both twins work on the same pixels.
      const Matrix& m = *matrix;
      const std::array<float, 3> in = {c[0], c[1], c[2]};
      for (int k = 0; k < 3; ++k) {
        const float v = (m[3 * k] * in[0] + m[3 * k + 1] * in[1]) + m[3 * k + 2] * in[2];
        c[k] = clamp_light(v);
        counts->clamped += c[k] != v;
        if (c[k] != v && !counts->first_bad_texel) counts->first_bad_texel = i;
      }
    }
    uint32_t negative = 0;
    for (int k = 0; k < 3; ++k) negative += c[k] < shader::NEGATIVE_BELOW;
    if (matrix) counts->negative_scene += negative;
    if (rounding == Rounding::kHalf || (rounding == Rounding::kHalfUnlessNegative && negative == 0)) {
      for (float& v : c) v = to_half(v);
    }
    scene.texels.push_back(c);
    if ((i + 1) % width == 0) row_done();
  }
  if (!matrix) counts->negative_scene = counts->negative;
  return scene;
}

uint32_t meter_weight(uint32_t x, uint32_t y, uint32_t width, uint32_t height, const MeterParams& params) {
  if (params.weights == shader::WEIGHTS_SPOT) {
    return x >= params.spot[0] && x < params.spot[2] && y >= params.spot[1] && y < params.spot[3] ? 1 : 0;
  }
  if (params.weights == shader::WEIGHTS_CENTER) {
    const int64_t dx = 2 * int64_t{x} + 1 - int64_t{width};
    const int64_t dy = 2 * int64_t{y} + 1 - int64_t{height};
    const int64_t step = 256 * (dx * dx + dy * dy) / (int64_t{width} * width + int64_t{height} * height);
    return static_cast<uint32_t>(std::lround(255.0 * std::exp(-2.0 * static_cast<double>(step) / 256.0)));
  }
  return 1;
}

Meter meter(const Scene& scene, const MeterParams& params) {
  constexpr double kBinsPerOctave = 64.0;
  struct Bin {
    double weight = 0.0;
    double sum = 0.0;
  };
  std::map<int, Bin> bins;  // by ascending luminance
  Meter m{0.0, std::numeric_limits<double>::infinity(), 0.0, 0, 0};
  const Coverage coverage(scene, params);
  double sum = 0.0;
  double lost = 0.0;  // Kahan summation, because the reference must not depend on 2^28 roundings
  for (uint32_t y = 0; y < scene.height; ++y) {
    for (uint32_t x = 0; x < scene.width; ++x) {
      const size_t at = size_t{y} * scene.width + x;
      const auto& c = scene.texels[at];
      const double l = luminance32(c);
      m.min_luminance = std::min(m.min_luminance, l);
      m.max_luminance = std::max(m.max_luminance, l);
      const bool absent = params.ignore_absent && !scene.absent.empty() && scene.absent[at];
      m.absent += absent;
      if (absent || l < params.ignore_below) continue;
      const uint32_t whole = meter_weight(x, y, scene.width, scene.height, params);
      const uint32_t weight = coverage.weight(whole, params.weights, alpha_code(c));
      m.weight += weight;
      const double log2_l = std::log2(std::max(l, kMinLuminance));
      const double term = weight * log2_l - lost;
      const double next = sum + term;
      lost = (next - sum) - term;
      sum = next;
      if (params.percentile) {
        Bin& bin = bins[static_cast<int>(std::floor(log2_l * kBinsPerOctave))];
        bin.weight += weight;
        bin.sum += weight * log2_l;
      }
    }
    row_done();
  }
  if (m.weight == 0) {
    m.mean_log2_luminance = std::log2(0.18);
    return m;
  }
  const auto total = static_cast<double>(m.weight);
  m.mean_log2_luminance = sum / total;
  if (!params.percentile) return m;

  // The mean over the mass between the percentiles. Each bin counts with its own mean, the two end bins in
  // part.
  const double low = params.percentile_low / 100.0 * total;
  const double high = params.percentile_high / 100.0 * total;
  double below = 0.0;
  double between = 0.0;
  for (const auto& [index, bin] : bins) {
    const double mass = std::max(0.0, std::min(high, below + bin.weight) - std::max(low, below));
    if (bin.weight > 0.0) between += mass * bin.sum / bin.weight;
    below += bin.weight;
  }
  m.mean_log2_luminance = between / (high - low);
  return m;
}

}  // namespace candela::reference
