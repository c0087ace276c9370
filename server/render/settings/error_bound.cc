#include "server/render/settings/error_bound.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "absl/strings/str_format.h"
#include "server/base/words.h"
#include "server/render/color/hdr_signal.h"
#include "server/render/color/portable_math.h"
#include "server/render/settings/settings.h"
#include "shaders/color_table.h"
#include "shaders/params.h"

namespace candela {
namespace {

// The relative error of one rounding to float32.
constexpr double kRounding = 0x1p-24;
// Roundings on the way from a scene texel through the curve, as relative errors of its light.
constexpr double kLightRoundings = 64;
// Roundings of the bright pass and of sampling bloom, and of one level on its way down and up.
constexpr double kBloomRoundings = 30;
constexpr double kLevelRoundings = 28;
// Roundings of a luminance that the bright pass compares with its threshold.
constexpr double kLuminanceRoundings = 24;
// Roundings of terms of both signs in a matrix, in bloom over negative light and in the curve after them.
constexpr double kCancelRoundings = 32;
// The largest component of a colour of luminance 1.
constexpr double kPureBlue = 1 / 0.0722;
// The error of the metered mean in EV: its logarithm and its fixed point, and the weights of PERCENTILE with
// CENTER.
constexpr double kMeanError = 8e-6;
constexpr double kBin = 1.0 / 64;  // of the histogram, in EV
// With straight alpha an object has at most this light, and light of its own is a difference from it.
constexpr double kObjectRoundings = 8 * shader::MAX_OBJECT_LIGHT;
// The error of the power of 1/2.2, in codes.
constexpr double kPowerCodes = 1e-3;

// A curve's sensitivity to errors of its light.
struct CurveError {
  double slope;     // display light to light, both the largest of R, G and B
  double relative;  // display light to a relative error of light
  double encoded;   // display value, sRGB or linear, to a relative error of light
  double cancels;   // display light that roundings leave where the curve subtracts; 0: it does not subtract
};

// What tables by hue, pieces of the tone scale and polynomials leave of aces-2, in every tier: without a
// negative component, and with them.
constexpr TableError kAces2Codes = {0.04, 1.5, 0.05};
constexpr TableError kAces2WideCodes = {0.3, 3, 0.08};

// Of an HDR display's signal, in codes: what the polynomials leave, and with bt2390 its signals of float32
// besides. What those leave of an SDR display's.
constexpr double kHdrCodes = 5e-4;
constexpr double kBt2390Codes = 8e-3;
constexpr double kBt2390SdrCodes = 0.05;
// The largest slopes of PQ and HLG over the logarithm of light; with HLG's OOTF.
constexpr double kPqSlope = 0.11;
constexpr double kHlgSlope = 0.3;
// The least part that a component has of its colour's luminance.
constexpr double kLeastOfLuminance = 0.0593;

// Per unit of a root in a table: M_out of r^2, at the largest root.
constexpr double kLightToRoot = 2 * shader::TABLE_MAX_ROOT * 2.21;
// The error of a position in a table, in points: its fraction's bits, and the roundings of the axis.
constexpr double kPositionError = 3e-5;

CurveError table_error(const ColorTable& table, double step) {
  const double points_per_octave = (table.size - 1) / table_axis_octaves(table.axes, table.end);
  const double knee = table.axes == shader::AXES_AP1 ? shader::TABLE_AXIS_KNEE_AP1 : shader::TABLE_AXIS_KNEE;
  const double light = 3 * kLightToRoot * step;  // to the next point of all three axes
  return {.slope = light * points_per_octave * 4 / (3 * knee),
          .relative = light * points_per_octave * 2,
          .encoded = 12.92 * light * points_per_octave * 2,
          .cancels = light * kPositionError};
}

CurveError hdr_error(const Settings& settings) {
  const double slope = settings->transfer() == v1::TRANSFER_PQ ? kPqSlope : kHlgSlope;
  // One factor for three components has the error of the largest, too.
  const double relative = settings->curve() == v1::TONE_CURVE_BT2390 ? 2 : 1;
  return {1, relative, relative * slope, 0};
}

CurveError curve_error(const Settings& settings) {
  if (is_hdr(*settings)) return hdr_error(settings);
  const double white = settings->curve_white();
  switch (settings->curve()) {
    case v1::TONE_CURVE_ACES_NARKOWICZ:
      return {2.0, 0.5, 1, 0};
    case v1::TONE_CURVE_ACES_HILL:
      return {1.6, 0.8, 3, 2.5e-7};
    case v1::TONE_CURVE_REINHARD_EXTENDED:
      return {2 * std::max(1.0, 1 / (white * white)), 2, 1, 0};
    case v1::TONE_CURVE_HABLE:
      return {1.0, 0.5, 1, 0};
    case v1::TONE_CURVE_AGX:
      return {2.0, 0.5, 1, 2.5e-7};
    case v1::TONE_CURVE_PBR_NEUTRAL:
      return {2.5, 2, 1.5, 2e-7};
    case v1::TONE_CURVE_ACES_1:
      return {8, 2, 6, 6e-6};
    case v1::TONE_CURVE_ACES_2:
      return {12, 3.3, 25, 2e-6};
    case v1::TONE_CURVE_BT2390:
    case v1::TONE_CURVE_SHOULDER:
      return {2, 2, 1, 0};
    case v1::TONE_CURVE_TABLE:
      return table_error(*settings.table(), settings.table_step());
    default:
      return {1, 1, 1, 0};
  }
}

// The relative error of bloom's light.
double bloom_rounding(const Settings& settings) {
  return kRounding * (kBloomRoundings + kLevelRoundings * settings->bloom().levels());
}

// The error of bloom's light where the bright pass subtracts its threshold, in the scene's units.
double bright_pass_error(const Settings& settings, double threshold, double largest) {
  const v1::Bloom& bloom = settings->bloom();
  if (bloom.kind() == v1::Bloom::KIND_CONSERVE) return 0;
  const double luminance = kLuminanceRoundings * kRounding;
  if (bloom.kind() == v1::Bloom::KIND_MIP) return kPureBlue * 3 * threshold * luminance;
  // GAUSSIAN: of Q, which shows the bright pass's error up to a luminance of 1 above the threshold.
  const double mean = portable_exp2(mean_error(settings->exposure().metering())) - 1;
  return std::min(largest, kPureBlue * (threshold + 1)) *
         (threshold * (mean + 2 * kRounding) + (threshold + 1) * luminance);
}

// The error of exposed light that is not relative to it.
double light_error(const Settings& settings, const BoundFacts& facts) {
  double error = 0;
  double rounding = kCancelRoundings * kRounding;
  if (facts.blooms) {
    error += facts.exposure * settings->bloom().intensity() *
             bright_pass_error(settings, facts.threshold, facts.largest);
    rounding += bloom_rounding(settings);
  }
  if (facts.wide) error += 2 * rounding * facts.negative_light;
  if (facts.translucent) error += kObjectRoundings * kRounding;
  return error;
}

double table_codes(const TableError& error, v1::Transfer transfer) {
  return transfer == v1::TRANSFER_SRGB      ? error.srgb
         : transfer == v1::TRANSFER_GAMMA22 ? error.gamma22
                                            : error.linear;
}

// The HLG signal of a component as dark as this beside which nothing brighter lifts the luminance. Above 1/12
// the logarithm is below the root.
double hlg_of_component(double light, double peak_nits) {
  const double e = light > 0 ? light * portable_power(kLeastOfLuminance * light, hlg_exponent(peak_nits)) : 0;
  return std::min(portable_power(3 * e, 0.5), 1.0);
}

// The encoding of display light, with the same bits on every machine. Each is concave and 0 at 0, so no error
// of light is larger when it is encoded than the encoded error.
double encoded(const Settings& settings, double light) {
  light = std::min(light, 1.0);  // infinity, too
  const v1::Transfer transfer = output_transfer(*settings);
  if (transfer == v1::TRANSFER_PQ) {
    return pq_signal(light * settings->peak_nits() / kPqPeakNits) - pq_signal(0);
  }
  if (transfer == v1::TRANSFER_HLG) return hlg_of_component(light, settings->peak_nits());
  if (transfer == v1::TRANSFER_GAMMA22) return portable_power(light, 1 / 2.2);
  if (transfer == v1::TRANSFER_LINEAR) return light;
  return light <= 0.0031308 ? 12.92 * light : 1.055 * portable_power(light, 1 / 2.4) - 0.055;
}

std::string words(const Tier& tier, double bound) {
  return bound < kNoBound
             ? absl::StrFormat("%s is within %s codes of the reference", tier.name, rounded_up(bound))
             : absl::StrFormat("%s has no bound", tier.name);
}

std::string words(const BoundFacts& facts) {
  return absl::StrFormat("%s%s", facts.blooms ? "it blooms" : "nothing in it blooms",
                         facts.wide ? " and it has negative components" : "");
}

}  // namespace

double mean_error(const v1::Metering& metering) {
  if (metering.statistic() != v1::Metering::STATISTIC_PERCENTILE) return kMeanError;
  const double low = metering.percentile_low() / 100;
  const double high = metering.percentile_high() / 100;
  return kMeanError + kBin * (low / high + (1 - high) / (1 - low));
}

double error_bound(const Tier& tier, const Settings& settings, const BoundFacts& facts) {
  if (tier.host_reference) return 0;
  if (facts.resized) return kNoBound;
  const bool sized_bloom = settings->bloom().kind() != v1::Bloom::KIND_GAUSSIAN;
  if (facts.blooms && sized_bloom && tier.bloom_level_size != kWholeBloom) return kNoBound;
  // Nothing bounds what its tables leave near the limit of its gamut, where PQ is steep.
  if (is_hdr(*settings) && settings->curve() == v1::TONE_CURVE_ACES_2) return kNoBound;
  const v1::Transfer transfer = output_transfer(*settings);
  const CurveError curve = curve_error(settings);
  const double rounding = kRounding * kLightRoundings + (facts.blooms ? bloom_rounding(settings) : 0);
  double light = curve.slope * light_error(settings, facts) + curve.cancels;
  double codes = 0;
  if (transfer == v1::TRANSFER_GAMMA22 && curve.cancels > 0) {
    light += curve.relative * rounding;
  } else {
    codes += 255 * curve.encoded * rounding;
  }
  codes += 255 * encoded(settings, light);
  if (is_hdr(*settings)) codes += kHdrCodes;
  if (settings->curve() == v1::TONE_CURVE_BT2390) codes += is_hdr(*settings) ? kBt2390Codes : kBt2390SdrCodes;
  if (transfer == v1::TRANSFER_SRGB) codes += tier.transfer_codes;
  if (transfer == v1::TRANSFER_GAMMA22) codes += kPowerCodes;
  if (settings->curve() == v1::TONE_CURVE_ACES_1) {
    codes += table_codes(facts.wide ? tier.wide_table_codes : tier.table_codes, transfer);
  }
  if (settings->curve() == v1::TONE_CURVE_ACES_2) {
    codes += table_codes(facts.wide ? kAces2WideCodes : kAces2Codes, transfer);
  }
  // Over white, the error of alpha counts as well as that of colour. A table's black need not be 0, and then
  // light of its own is a difference of two values of the table, in colour and in alpha.
  if (facts.translucent) codes *= settings->curve() == v1::TONE_CURVE_TABLE ? 4 : 2;
  return std::min(codes, kNoBound);
}

BoundFacts easiest_facts() { return {}; }

BoundFacts hardest_facts(const FrameDesc& desc, const Settings& settings) {
  const bool unsigned_pixels = desc.format == v1::PIXEL_FORMAT_RGB9E5;
  BoundFacts facts;
  facts.blooms = settings->bloom().intensity() > 0;
  facts.wide = !unsigned_pixels || settings.to_scene();
  facts.translucent = !unsigned_pixels && settings->alpha() == v1::ALPHA_STRAIGHT;
  facts.exposure = shader::MAX_EXPOSURE;
  facts.threshold = shader::MAX_HALF;  // beyond it components may be negative, too
  facts.negative_light = std::numeric_limits<double>::infinity();
  facts.resized = resizes(*settings, desc);
  return facts;
}

std::span<const Tier> tiers_in_question(const FrameDesc& desc, const Settings& settings) {
  const BoundFacts hardest = hardest_facts(desc, settings);
  const double most = settings->max_error_codes();
  const std::span<const Tier> all = tiers();
  BoundFacts easiest = easiest_facts();
  easiest.resized = hardest.resized;
  size_t first = 0;
  while (error_bound(all[first], settings, easiest) > most) ++first;
  size_t last = first;
  while (error_bound(all[last], settings, hardest) > most) ++last;
  return all.subspan(first, last - first + 1);
}

std::string reason_for(const Tier& tier, double bound, const Settings& settings, const BoundFacts& facts) {
  std::string cheaper;
  for (const Tier& other : tiers()) {
    if (&other >= &tier) break;
    cheaper += absl::StrFormat("; %s here", words(other, error_bound(other, settings, facts)));
  }
  return absl::StrFormat("%s for this frame: %s; it keeps max_error_codes %g%s", words(tier, bound),
                         words(facts), settings->max_error_codes(), cheaper);
}

}  // namespace candela
