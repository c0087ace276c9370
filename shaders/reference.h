// The float64 reference: every pass again as plain loops over whole images, without optimisation.
//
// Each x.comp has a twin x.ref.cc beside it. The two share parameters but no formulas, so that each is
// evidence for the other. The references follow the mathematics in docs/pipeline.md. A scene takes 16 bytes
// per texel, a level 24. The functions keep no state but the hook below, so any thread may call them.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "shaders/color_table.h"
#include "shaders/params.h"

namespace candela::reference {

using shader::uint;
using Rgb = std::array<double, 3>;
using Matrix = std::array<float, 9>;  // row by row

// The twins that make or read a whole image call this after each row, on the thread of their caller, who may
// pause there. Each thread has its own; null: nothing is called. If it throws, the image is lost.
using RowHook = void (*)();
inline constinit thread_local RowHook after_row = nullptr;
inline void row_done() {
  if (after_row != nullptr) after_row();
}

// A frame's scene pixels, row by row from the top. Floats hold every wire format exactly.
struct Scene {
  uint32_t width = 0;
  uint32_t height = 0;
  std::vector<std::array<float, 4>> texels;
  std::vector<bool> absent;  // texels with no light on the wire and an alpha of 0 or less; empty: none

  // The texel at (x, y). Coordinates beyond the edge are clamped to it.
  const std::array<float, 4>& at(int64_t x, int64_t y) const;
};

// A bloom level, row by row from the top.
struct Level {
  uint32_t width = 0;
  uint32_t height = 0;
  std::vector<Rgb> texels;

  const Rgb& at(int64_t x, int64_t y) const;
};

// Counts over the R, G and B components on the wire.
struct BadCounts {
  uint64_t nan = 0;
  uint64_t infinite = 0;
  uint64_t clamped = 0;  // finite and beyond +-MAX_LIGHT, on the wire or after the matrix
  uint64_t negative = 0;
  uint64_t negative_scene = 0;  // of the scene; without a matrix the same as `negative`
  // y * width + x of the first texel with a NaN, an Inf or such a component in R, G or B.
  std::optional<uint64_t> first_bad_texel;
};

struct MeterParams {
  bool percentile = false;  // the mean covers only the mass between the two percentiles
  double percentile_low = 10.0;
  double percentile_high = 90.0;
  uint weights = shader::WEIGHTS_AVERAGE;
  std::array<uint32_t, 4> spot{};  // for WEIGHTS_SPOT: x0, y0, x1, y1 in texels, ends excluded
  float ignore_below = 0.0f;       // texels of less luminance have no weight
  bool ignore_absent = true;  // alpha counts: texels have their alpha's part of the weight, absent ones none
};

struct Meter {
  double mean_log2_luminance = 0.0;  // log2 0.18 if nothing is metered
  double min_luminance = 0.0;
  double max_luminance = 0.0;
  uint64_t weight = 0;  // the sum of all texels' weights; 0 if nothing is metered
  uint64_t absent = 0;  // the number of absent texels; 0 if they are metered
};

struct BloomSpec {
  uint kind = shader::BLOOM_MIP;
  double threshold = 1.0;  // luminance; for BLOOM_GAUSSIAN a multiple of the metered mean
  double softness = 0.5;
  uint32_t levels = 5;
  bool firefly_weights = true;
  // Frame texels per texel of the finest level, along a side. 2, or 4: then the means of 2x2 texels of D_0
  // stand for D_1 and, counted twice, for D_0.
  uint32_t level_size = 2;
};

// The primaries in which a curve cuts light at 0, after its first matrix: Rec.709 without a matrix, those of
// aces-hill and of AXES_ACES, ACES AP1, AgX's inset, or those of an HDR display.
enum class Gamut { kRec709, kAces, kAp1, kAgx, kRec2020, kP3D65 };

struct ResolveParams {
  double exposure = 1.0;  // E * prescale
  uint bloom = shader::BLOOM_NONE;
  uint32_t level_size = 2;  // as in BloomSpec; 4 for BLOOM_GAUSSIAN
  double bloom_intensity = 0.0;
  uint curve = shader::CURVE_ACES_HILL;
  Gamut gamut = Gamut::kAces;  // the curve's; only for cut_components()
  // Of reinhard-extended the luminance that becomes white; of bt2390 and shoulder without PQ and HLG the
  // source's peak, in units of white.
  double curve_white = 4.0;
  uint transfer = shader::TRANSFER_SRGB;
  // Of TRANSFER_PQ and TRANSFER_HLG, for which exposed and display light are in units of the display's peak.
  uint display = shader::DISPLAY_REC709;
  uint limit = shader::DISPLAY_REC709;  // of aces-2
  double peak_nits = 0.0;
  double source_peak_nits = 0.0;  // of bt2390, with PQ and HLG
  uint alpha = shader::ALPHA_ASSOCIATED;
  Rgb background{};  // scene light, for ALPHA_OVER
  // Exposed scene light, which may be negative, to display light, not clamped. CURVE_ACES_1 and CURVE_TABLE
  // need it, because they have no formula. Of an HDR display, in its primaries.
  std::function<Rgb(const Rgb&)> look;
  // If there is one, alpha is this of exposed light: the code, 0 .. 1, of a gain map.
  std::function<double(const Rgb&)> gain_code;
};

// Whether ingest() rounds the scene's components within +-65504 to halves, as the pipeline does for metering
// and bloom, leaves colours with a negative component as they are, as resolve does, or leaves all of them.
enum class Rounding { kHalf, kHalfUnlessNegative, kNone };

// Luminance is metered no darker than this, and bloom divides by no less.
inline constexpr double kMinLuminance = 1e-4;
// The largest finite half.
inline constexpr float kHalfMax = 65504.0f;

// Rec.709 luminance.
inline double luminance(const Rgb& c) { return 0.2126 * c[0] + 0.7152 * c[1] + 0.0722 * c[2]; }

// Scene pixels from wire bytes in one of the PIXELS_* formats, with rows `stride_bytes` apart. `matrix` takes
// the input primaries to Rec.709. Sets *counts.
Scene ingest(std::span<const std::byte> wire, size_t stride_bytes, uint32_t width, uint32_t height,
             uint pixels, const std::optional<Matrix>& matrix, Rounding rounding, BadCounts* counts);

Meter meter(const Scene& scene, const MeterParams& params = {});
// The metering weight of texel (x, y) in a width x height frame, 0 .. 255, if its luminance is not ignored
// and its alpha is 1.
uint32_t meter_weight(uint32_t x, uint32_t y, uint32_t width, uint32_t height, const MeterParams& params);

// D_0 of the mip kinds. Negative components of the scene count as 0.
Level bright_pass(const Scene& scene, const BloomSpec& params);
// D_{n+1} from D_n.
Level bloom_down(const Level& level);
// B_n = weight * D_n + U_n(B_{n+1}).
Level bloom_up(Level fine, const Level& coarse, double weight = 1.0);
// B_0 of a scene: the whole chain. `mean_log2_luminance` is the frame's metered mean. Sets *level_count to
// the number of levels used, which is 1 for BLOOM_GAUSSIAN.
Level bloom(const Scene& scene, const BloomSpec& params, double mean_log2_luminance, uint32_t* level_count);
// BLOOM_GAUSSIAN's blurred quarter-size level.
Level gaussian_bloom(const Scene& scene, double threshold);

// The display values of row y before dither and quantisation, and alpha, which is not clamped. It makes one
// row at a time, because a whole image takes 32 bytes per texel, or only texels `first` <= x < `last` of it.
// `bloom` is B_0; for BLOOM_NONE it may be empty.
std::vector<std::array<double, 4>> resolve_row(const Scene& scene, const Level& bloom, uint32_t level_count,
                                               const ResolveParams& params, uint32_t y, uint32_t first,
                                               uint32_t last);
std::vector<std::array<double, 4>> resolve_row(const Scene& scene, const Level& bloom, uint32_t level_count,
                                               const ResolveParams& params, uint32_t y);

// Texels of scene light with bloom, before exposure and background, and their alpha.
using Light = std::array<double, 4>;
Light light_at(const Scene& scene, const Level& bloom, uint32_t level_count, const ResolveParams& params,
               uint32_t x, uint32_t y);

// The scene of a width x height image of the frame's light, bloom included: resolve it with BLOOM_NONE.
Scene resize(const Scene& scene, const Level& bloom, uint32_t level_count, const ResolveParams& params,
             uint32_t width, uint32_t height);

// The light of row y on an HDR display, in its primaries and units of its peak, 0 .. 1; with straight alpha
// that of the texels' objects.
std::vector<Rgb> light_row(const Scene& scene, const Level& bloom, uint32_t level_count,
                           const ResolveParams& params, uint32_t y);

// How many components of row y the curve cuts because they lie outside its gamut: those that are negative in
// its primaries by more than GAMUT_TOLERANCE of the colour's largest component. Computed in float32, so that
// both twins count the same.
uint64_t cut_components(const Scene& scene, const Level& bloom, uint32_t level_count,
                        const ResolveParams& params, uint32_t y);

// Display light for exposed scene light by a colour table, not clamped.
Rgb look_up(const ColorTable& table, const Rgb& exposed);

// Display-linear light in [0, 1] for exposed scene light, which may be negative, by a curve that has no
// table. `white` is ResolveParams::curve_white.
Rgb tone_curve(uint curve, const Rgb& x, double white = 4.0);
// The display value in [0, 1] for display-linear light y in [0, 1].
double transfer(uint transfer, double y);

// The triangular noise of texel (x, y) in component 0 .. 2, within (-1, 1), in codes of the output.
double dither_noise(uint32_t x, uint32_t y, uint32_t frame, size_t component);

// `level` at (u, v) in texels, with texel (x, y) at exactly (x, y). AnyLevel::at(x, y) must know
// what lies beyond its edge: Level's clamps.
template <typename AnyLevel>
Rgb bilinear(const AnyLevel& level, double u, double v) {
  const double x0 = std::floor(u);
  const double y0 = std::floor(v);
  const double fx = u - x0;
  const double fy = v - y0;
  const auto x = static_cast<int64_t>(x0);
  const auto y = static_cast<int64_t>(y0);
  Rgb out;
  for (int n = 0; n < 3; ++n) {
    out[n] = (1 - fy) * ((1 - fx) * level.at(x, y)[n] + fx * level.at(x + 1, y)[n]) +
             fy * ((1 - fx) * level.at(x, y + 1)[n] + fx * level.at(x + 1, y + 1)[n]);
  }
  return out;
}

}  // namespace candela::reference
