// Twin of resolve.comp: composite, exposure, tone curve and transfer.
#include <algorithm>
#include <cmath>

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

// The scene's light with bloom and background, before exposure.
Rgb composite(const Scene& scene, const Level& bloom, uint32_t level_count, const ResolveParams& params,
              uint32_t x, uint32_t y) {
  const Light light = light_at(scene, bloom, level_count, params, x, y);
  Rgb c = {light[0], light[1], light[2]};
  if (params.alpha == shader::ALPHA_OVER) {
    const double rest = 1.0 - std::clamp<double>(light[3], 0.0, 1.0);
    for (int n = 0; n < 3; ++n) c[n] += rest * params.background[n];
  }
  return c;
}

Rgb exposed_at(const Scene& scene, const Level& bloom, uint32_t level_count, const ResolveParams& params,
               uint32_t x, uint32_t y) {
  Rgb c = composite(scene, bloom, level_count, params, x, y);
  for (double& v : c) {
    v = std::clamp(v * params.exposure, -double{shader::MAX_EXPOSED_VALUE},
                   double{shader::MAX_EXPOSED_VALUE});
  }
  return c;
}

Rgb aces_hill(const Rgb& x) {
  static constexpr double kInput[3][3] = {
      {0.59719, 0.35458, 0.04823}, {0.07600, 0.90834, 0.01566}, {0.02840, 0.13383, 0.83777}};
  static constexpr double kOutput[3][3] = {
      {1.60475, -0.53108, -0.07367}, {-0.10208, 1.10813, -0.00605}, {-0.00327, -0.07276, 1.07602}};
  Rgb v = multiply(kInput, x);
  for (double& c : v) c = std::max(c, 0.0);
  for (double& c : v) c = (c * (c + 0.0245786) - 0.000090537) / (c * (0.983729 * c + 0.4329510) + 0.238081);
  return multiply(kOutput, v);
}

// Hable's published curve with its published letters.
double hable(double x) {
  constexpr double kA = 0.15;
  constexpr double kB = 0.50;
  constexpr double kC = 0.10;
  constexpr double kD = 0.20;
  constexpr double kE = 0.02;
  constexpr double kF = 0.30;
  const auto base = [&](double v) {
    return (v * (kA * v + kC * kB) + kD * kE) / (v * (kA * v + kB) + kD * kF) - kE / kF;
  };
  return base(2.0 * x) / base(11.2);
}

// Sobotka's base curve: a hyperbolic toe and shoulder that meet at (kX, kY) with slope kSlope and end at (0,
// 0) and (1, 1).
double agx_base(double v) {
  constexpr double kX = 10.0 / 16.5;
  constexpr double kY = 0.5;
  constexpr double kSlope = 2.0;
  const auto scale = [](double x, double y, double p) {
    return std::pow(std::pow(kSlope * x, -p) * (std::pow(kSlope * x / y, p) - 1.0), -1.0 / p);
  };
  const bool toe = v < kX;
  const double p = toe ? 3.0 : 3.25;
  const double s = toe ? -scale(kX, kY, p) : scale(1.0 - kX, 1.0 - kY, p);
  const double term = kSlope * (v - kX) / s;
  return s * term / std::pow(1.0 + std::pow(term, p), 1.0 / p) + kY;
}

Rgb agx(const Rgb& x) {
  static constexpr double kInset[3][3] = {{0.842479062253094, 0.0784335999999992, 0.0792237451477643},
                                          {0.0423282422610123, 0.878468636469772, 0.0791661274605434},
                                          {0.0423756549057051, 0.0784336, 0.879142973793104}};
  Rgb y = multiply(kInset, x);
  for (double& c : y) {
    const double stops = std::log2(std::max(c, 1e-10));
    c = std::clamp((stops + 12.47393) / (4.026069 + 12.47393), 0.0, 1.0);
    c = std::pow(std::max(agx_base(c), 0.0), 2.2);
  }
  return y;
}

Rgb pbr_neutral(Rgb c) {
  constexpr double kStart = 0.8 - 0.04;
  constexpr double kDesaturation = 0.15;
  const double least = std::min({c[0], c[1], c[2]});
  const double offset = least < 0.08 ? least - 6.25 * least * least : 0.04;
  for (double& v : c) v -= offset;
  const double peak = std::max({c[0], c[1], c[2]});
  if (peak < kStart) return c;
  const double d = 1.0 - kStart;
  const double new_peak = 1.0 - d * d / (peak + d - kStart);
  const double g = 1.0 - 1.0 / (kDesaturation * (peak - new_peak) + 1.0);
  for (double& v : c) v = (1.0 - g) * v * new_peak / peak + g * new_peak;
  return c;
}

constexpr double kWhiteNits = 203;  // ITU-R BT.2408

// ST 2084's constants.
constexpr double kM1 = 2610.0 / 16384;
constexpr double kM2 = 2523.0 / 32;
constexpr double kC1 = 3424.0 / 4096;
constexpr double kC2 = 2413.0 / 128;
constexpr double kC3 = 2392.0 / 128;

double pq(double nits) {
  const double y = std::pow(nits / 10000.0, kM1);
  return std::pow((kC1 + kC2 * y) / (1.0 + kC3 * y), kM2);
}

double pq_nits(double signal) {
  const double p = std::pow(signal, 1.0 / kM2);
  return 10000.0 * std::pow(std::max(p - kC1, 0.0) / (kC2 - kC3 * p), 1.0 / kM1);
}

// BT.2390-10 section 5.4.1, with black levels of 0: one factor by the largest component.
Rgb bt2390(const Rgb& light, double source_nits, double peak_nits) {
  const double largest = std::max({light[0], light[1], light[2]});
  if (largest <= 0.0) return {};
  const double source = pq(source_nits);
  const double most = pq(peak_nits) / source;
  const double start = 1.5 * most - 0.5;
  const double e1 = std::min(pq(std::min(largest * peak_nits, 10000.0)) / source, 1.0);
  if (e1 < start) return light;
  const double t = start < 1.0 ? (e1 - start) / (1.0 - start) : 0.0;
  const double e2 = (2 * t * t * t - 3 * t * t + 1) * start + (t * t * t - 2 * t * t + t) * (1.0 - start) +
                    (-2 * t * t * t + 3 * t * t) * most;
  const double factor = pq_nits(e2 * source) / peak_nits / largest;
  return {light[0] * factor, light[1] * factor, light[2] * factor};
}

Rgb shoulder(Rgb light, double peak) {
  const double largest = std::max({light[0], light[1], light[2]});
  if (largest <= 0.5) return light;
  const double above = (std::min(largest, peak) - 0.5) / 0.5, end = (peak - 0.5) / 0.5;
  const double shown = 0.5 + 0.5 * (above + above * above / (end * end)) / (1.0 + above);
  for (double& c : light) c *= shown / largest;
  return light;
}

// Scene light in the primaries of an HDR display.
Rgb in_display(const ResolveParams& params, const Rgb& c) {
  static constexpr double kRec2020[3][3] = {{0.627403895934699, 0.329283038377884, 0.043313065687417},
                                            {0.069097289358232, 0.919540395075459, 0.011362315566309},
                                            {0.016391438875150, 0.088013307877226, 0.895595253247624}};
  static constexpr double kP3[3][3] = {{0.822461968714212, 0.177538031285788, 0.0},
                                       {0.033194198850962, 0.966805801149038, 0.0},
                                       {0.017082630721370, 0.072397441007155, 0.910519928271475}};
  if (params.display == shader::DISPLAY_REC709) return c;
  return multiply(params.display == shader::DISPLAY_P3_D65 ? kP3 : kRec2020, c);
}

// Display light in [0, 1].
Rgb display_light(const ResolveParams& params, const Rgb& exposed) {
  if (params.look) {
    Rgb y = params.look(exposed);
    for (double& v : y) v = std::clamp(v, 0.0, 1.0);
    return y;
  }
  if (params.display == shader::DISPLAY_REC709) return tone_curve(params.curve, exposed, params.curve_white);
  Rgb y = in_display(params, exposed);
  for (double& v : y) v = std::max(v, 0.0);
  if (params.curve == shader::CURVE_BT2390) y = bt2390(y, params.source_peak_nits, params.peak_nits);
  for (double& v : y) v = std::min(v, 1.0);
  return y;
}

// BT.2100's OETF of the light before the OOTF, which gives E on the display as Y^(g - 1) E.
Rgb hlg(const ResolveParams& params, const Rgb& light) {
  static constexpr double kRec2020[] = {0.262700212011267, 0.677998071518871, 0.059301716469862};
  static constexpr double kP3[] = {0.228974564069749, 0.691738521836506, 0.079286914093745};
  const double* const weights = params.display == shader::DISPLAY_P3_D65 ? kP3 : kRec2020;
  const double luminance = weights[0] * light[0] + weights[1] * light[1] + weights[2] * light[2];
  if (luminance <= 0.0) return {};
  const double gamma = 1.2 + 0.42 * std::log10(params.peak_nits / 1000.0);
  Rgb signal;
  for (int n = 0; n < 3; ++n) {
    const double e = light[n] * std::pow(luminance, (1.0 - gamma) / gamma);
    signal[n] =
        e <= 1.0 / 12 ? std::sqrt(3.0 * e) : 0.17883277 * std::log(12.0 * e - 0.28466892) + 0.55991073;
    signal[n] = std::min(signal[n], 1.0);
  }
  return signal;
}

Rgb encoded(const ResolveParams& params, Rgb y) {
  if (params.transfer == shader::TRANSFER_HLG) return hlg(params, y);
  for (double& v : y) {
    v = params.transfer == shader::TRANSFER_PQ ? pq(v * params.peak_nits) : transfer(params.transfer, v);
  }
  return y;
}

Rgb shown(const ResolveParams& params, const Rgb& exposed) {
  return encoded(params, display_light(params, exposed));
}

// The light of a pixel of which an object covers a part: both are not multiplied by alpha.
struct Parts {
  Rgb object{};  // divided by alpha
  Rgb own{};
};

Parts parts_of(const Rgb& c, double a) {
  Parts parts;
  const double size = std::max({std::abs(c[0]), std::abs(c[1]), std::abs(c[2])});
  const bool part_of_it = (1.0 - a) * size > shader::MAX_OBJECT_LIGHT * a;
  for (int n = 0; n < 3; ++n) {
    const double part = part_of_it ? c[n] * shader::MAX_OBJECT_LIGHT * a / ((1.0 - a) * size) : c[n];
    parts.own[n] = c[n] - part;
    parts.object[n] = a > 0.0 ? part / a : 0.0;
  }
  return parts;
}

// Colour and alpha of a pixel with exposed light `c` and alpha a, 0 .. 1, neither associated.
std::array<double, 4> straight(const ResolveParams& params, const Rgb& c, double a) {
  const auto [object, own] = parts_of(c, a);
  Rgb glow{};
  if (own != Rgb{}) {
    const Rgb black = shown(params, {});
    glow = shown(params, own);
    for (int n = 0; n < 3; ++n) glow[n] = std::max(0.0, glow[n] - black[n]);
  }
  const Rgb body = shown(params, object);
  const double alpha = a + (1.0 - a) * std::max({glow[0], glow[1], glow[2]});
  std::array<double, 4> pixel = {0.0, 0.0, 0.0, alpha};
  for (int n = 0; n < 3 && alpha > 0.0; ++n) pixel[n] = (a * body[n] + (1.0 - a) * glow[n]) / alpha;
  return pixel;
}

}  // namespace

Light light_at(const Scene& scene, const Level& bloom, uint32_t level_count, const ResolveParams& params,
               uint32_t x, uint32_t y) {
  const auto& s = scene.at(x, y);
  Light c = {s[0], s[1], s[2], s[3]};
  if (params.bloom == shader::BLOOM_NONE) return c;
  const double size = params.level_size;
  const Rgb b = bilinear(bloom, (x + 0.5) / size - 0.5, (y + 0.5) / size - 0.5);
  const double kept = params.bloom == shader::BLOOM_CONSERVE ? 1.0 - params.bloom_intensity : 1.0;
  for (int n = 0; n < 3; ++n) c[n] = kept * c[n] + params.bloom_intensity * b[n] / level_count;
  return c;
}

Rgb tone_curve(uint curve, const Rgb& light, double white) {
  const Rgb x = {std::max(light[0], 0.0), std::max(light[1], 0.0), std::max(light[2], 0.0)};
  Rgb y = x;
  switch (curve) {
    case shader::CURVE_REINHARD:
      for (double& c : y) c = c / (1.0 + c);
      break;
    case shader::CURVE_REINHARD_EXTENDED:
      for (double& c : y) c *= (1.0 + luminance(x) / (white * white)) / (1.0 + luminance(x));
      break;
    case shader::CURVE_ACES_NARKOWICZ:
      for (double& c : y) c = c * (2.51 * c + 0.03) / (c * (2.43 * c + 0.59) + 0.14);
      break;
    case shader::CURVE_ACES_HILL:
      y = aces_hill(light);
      break;
    case shader::CURVE_HABLE:
      for (double& c : y) c = hable(c);
      break;
    case shader::CURVE_AGX:
      y = agx(light);
      break;
    case shader::CURVE_PBR_NEUTRAL:
      y = pbr_neutral(x);
      break;
    case shader::CURVE_BT2390:
      y = bt2390(x, white * kWhiteNits, kWhiteNits);
      break;
    case shader::CURVE_SHOULDER:
      y = shoulder(x, white);
      break;
    default:
      break;
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

double dither_noise(uint32_t x, uint32_t y, uint32_t frame, size_t component) {
  // pcg3d: a linear congruential step on each word, then two rounds of products with the high bits folded
  // into the low ones between them.
  std::array<uint32_t, 3> v = {x, y, frame};
  for (uint32_t& w : v) w = w * 1664525u + 1013904223u;
  for (int round = 0; round < 2; ++round) {
    for (size_t i = 0; i < 3; ++i) v[i] += v[(i + 1) % 3] * v[(i + 2) % 3];
    if (round == 0) {
      for (uint32_t& w : v) w ^= w >> 16;
    }
  }
  return (static_cast<double>(v[component] % 65536u) - static_cast<double>(v[component] / 65536u)) / 65536.0;
}

std::vector<std::array<double, 4>> resolve_row(const Scene& scene, const Level& bloom, uint32_t level_count,
                                               const ResolveParams& params, uint32_t y) {
  return resolve_row(scene, bloom, level_count, params, y, 0, scene.width);
}

std::vector<std::array<double, 4>> resolve_row(const Scene& scene, const Level& bloom, uint32_t level_count,
                                               const ResolveParams& params, uint32_t y, uint32_t first,
                                               uint32_t last) {
  std::vector<std::array<double, 4>> row;
  row.reserve(last - first);
  for (uint32_t x = first; x < last; ++x) {
    Rgb c = exposed_at(scene, bloom, level_count, params, x, y);
    const double alpha = scene.at(x, y)[3];
    if (params.alpha == shader::ALPHA_STRAIGHT) {
      row.push_back(straight(params, c, std::clamp(alpha, 0.0, 1.0)));
      continue;
    }
    const Rgb values = shown(params, c);
    const double kept = params.alpha == shader::ALPHA_ASSOCIATED ? alpha : 1.0;
    row.push_back({values[0], values[1], values[2], params.gain_code ? params.gain_code(c) : kept});
  }
  return row;
}

std::vector<Rgb> light_row(const Scene& scene, const Level& bloom, uint32_t level_count,
                           const ResolveParams& params, uint32_t y) {
  std::vector<Rgb> row;
  row.reserve(scene.width);
  for (uint32_t x = 0; x < scene.width; ++x) {
    Rgb c = exposed_at(scene, bloom, level_count, params, x, y);
    if (params.alpha == shader::ALPHA_STRAIGHT) {
      c = parts_of(c, std::clamp<double>(scene.at(x, y)[3], 0.0, 1.0)).object;
    }
    row.push_back(display_light(params, c));
  }
  return row;
}

uint64_t cut_components(const Scene& scene, const Level& bloom, uint32_t level_count,
                        const ResolveParams& params, uint32_t y) {
  static constexpr float kLinear[] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
  static constexpr float kAces[] = {TABLE_FROM_SCENE};
  static constexpr float kAp1[] = {TABLE_FROM_SCENE_AP1};
  static constexpr float kAgx[] = {0.842479062253094f,  0.0784335999999992f, 0.0792237451477643f,
                                   0.0423282422610123f, 0.878468636469772f,  0.0791661274605434f,
                                   0.0423756549057051f, 0.0784336f,          0.879142973793104f};
  static constexpr float kRec2020[] = {REC709_TO_REC2020};
  static constexpr float kP3[] = {REC709_TO_P3_D65};
  static constexpr const float* kMatrices[] = {kLinear, kAces, kAp1, kAgx, kRec2020, kP3};
  const float* const m = kMatrices[static_cast<size_t>(params.gamut)];
  uint64_t cut = 0;
  for (uint32_t x = 0; x < scene.width; ++x) {
    const Rgb c = composite(scene, bloom, level_count, params, x, y);
    std::array<float, 3> light;
    float largest = 0.0f;
    for (size_t k = 0; k < 3; ++k) {
      light[k] = static_cast<float>(c[k]) * static_cast<float>(params.exposure);
      light[k] = std::clamp(light[k], -shader::MAX_EXPOSED_VALUE, shader::MAX_EXPOSED_VALUE);
      largest = std::max(largest, std::abs(light[k]));
    }
    for (size_t k = 0; k < 3; ++k) {
      const float v = (m[3 * k] * light[0] + m[3 * k + 1] * light[1]) + m[3 * k + 2] * light[2];
      cut += v < -shader::GAMUT_TOLERANCE * largest;
    }
  }
  return cut;
}

}  // namespace candela::reference
