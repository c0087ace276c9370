// The truth: every pass again in float64, straight loops over whole images, no tricks.
//
// x.comp and x.ref.cc stand side by side and share parameters, never formulas, so that each is evidence for
// the other. Written from the mathematics in docs/pipeline.md. A scene takes 16 bytes a texel, a level 24.
#pragma once

#include <array>
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

// Texels row by row, as floats: the wire's own precision, and more than the halves that they are rounded to.
struct Scene {
  uint32_t width = 0;
  uint32_t height = 0;
  std::vector<std::array<float, 4>> texels;

  // The texel at (x, y), clamped to the edge.
  const std::array<float, 4>& at(int64_t x, int64_t y) const;
};

struct Level {
  uint32_t width = 0;
  uint32_t height = 0;
  std::vector<Rgb> texels;

  const Rgb& at(int64_t x, int64_t y) const;
};

// R, G and B components on the wire.
struct BadCounts {
  uint64_t nan = 0;
  uint64_t infinite = 0;
  uint64_t negative = 0;
  // y * width + x of the first texel with a NaN or an Inf in R, G or B.
  std::optional<uint64_t> first_bad_texel;
};

struct MeterParams {
  bool percentile = false;  // mean over the mass between the two percentiles only
  double percentile_low = 10.0;
  double percentile_high = 90.0;
  uint weights = shader::WEIGHTS_AVERAGE;
  std::array<uint32_t, 4> spot{};  // of WEIGHTS_SPOT: x0, y0, x1, y1
};

struct Meter {
  double mean_log2_luminance = 0.0;
  double min_luminance = 0.0;
  double max_luminance = 0.0;
  uint64_t weight = 0;  // the sum of all texels' weights
};

struct BloomSpec {
  uint kind = shader::BLOOM_MIP;
  double threshold = 1.0;  // of BLOOM_GAUSSIAN a multiple of the metered mean
  double softness = 0.5;
  uint32_t levels = 5;
  bool firefly_weights = true;
  uint32_t level_size =
      2;  // 4: the means of 2x2 texels of D_0 take the place of D_1 and, counted twice, of D_0
};

struct ResolveParams {
  double exposure = 1.0;  // E * prescale
  uint bloom = shader::BLOOM_NONE;
  uint32_t level_size = 2;  // as in BloomSpec; 4 for BLOOM_GAUSSIAN
  double bloom_intensity = 0.0;
  uint curve = shader::CURVE_ACES_HILL;
  double curve_white = 4.0;  // of reinhard-extended
  uint transfer = shader::TRANSFER_SRGB;
  // Exposed scene light to display light, not clamped; what CURVE_ACES_1 and CURVE_TABLE need in place of a
  // formula.
  std::function<Rgb(const Rgb&)> look;
};

// The scene's texels are halves, as the pipeline has them, or what they were before they were rounded.
enum class Rounding { kHalf, kNone };

// Luminance is metered no darker than this, and bloom divides by no less.
inline constexpr double kMinLuminance = 1e-4;
// The largest finite half.
inline constexpr float kHalfMax = 65504.0f;

// Of Rec.709.
inline double luminance(const Rgb& c) { return 0.2126 * c[0] + 0.7152 * c[1] + 0.0722 * c[2]; }

// Wire bytes (rows `stride_bytes` apart, PIXELS_* format) to scene pixels. `matrix`: input primaries to
// Rec.709.
Scene ingest(std::span<const std::byte> wire, size_t stride_bytes, uint32_t width, uint32_t height,
             uint pixels, const std::optional<Matrix>& matrix, Rounding rounding, BadCounts* counts);

Meter meter(const Scene& scene, const MeterParams& params = {});
// The weight of a texel of a width x height frame, 0 .. 255.
uint32_t meter_weight(uint32_t x, uint32_t y, uint32_t width, uint32_t height, const MeterParams& params);

// D_0 of the mip kinds, negatives of the scene cut.
Level bright_pass(const Scene& scene, const BloomSpec& params);
// D_{n+1} from D_n.
Level bloom_down(const Level& level);
// B_n = weight * D_n + U_n(B_{n+1}).
Level bloom_up(Level fine, const Level& coarse, double weight = 1.0);
// B_0 of a scene: the whole chain; *level_count is the N that it used, 1 for BLOOM_GAUSSIAN.
// `mean_log2_luminance`: the frame's metered one.
Level bloom(const Scene& scene, const BloomSpec& params, double mean_log2_luminance, uint32_t* level_count);
// BLOOM_GAUSSIAN's blurred quarter-size level.
Level gaussian_bloom(const Scene& scene, double threshold);

// The display values of row y, before dither and quantising: RGB as ResolveParams says, alpha as it is. A row
// at a time, for whole images of them take 32 bytes a texel. `bloom` is B_0, and may be empty for BLOOM_NONE.
std::vector<std::array<double, 4>> resolve_row(const Scene& scene, const Level& bloom, uint32_t level_count,
                                               const ResolveParams& params, uint32_t y);

// Exposed scene light to display light by a table, not clamped.
Rgb look_up(const ColorTable& table, const Rgb& exposed);

// Exposed scene light to display-linear light in [0, 1]; of the curves without a table. `white`: of
// reinhard-extended.
Rgb tone_curve(uint curve, const Rgb& x, double white = 4.0);
double transfer(uint transfer, double y);

// Triangular noise of texel (x, y), component 0 .. 2, in codes of the output: (-1, 1).
double dither_noise(uint32_t x, uint32_t y, uint32_t frame, size_t component);

}  // namespace candela::reference
