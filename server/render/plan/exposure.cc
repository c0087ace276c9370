#include "server/render/plan/exposure.h"

#include <algorithm>
#include <cmath>

#include "absl/strings/str_format.h"
#include "proto/candela/v1/limits.h"
#include "server/base/check.h"
#include "server/base/status_macros.h"
#include "server/render/color/portable_math.h"
#include "shaders/params.h"

namespace candela {
namespace {

constexpr double kBinsPerOctave = 1u << (shader::LOG2_FRACTION_BITS - shader::HISTOGRAM_SHIFT);
static_assert(kBinsPerOctave == kHistogramBinsPerEv && -kHistogramFirstEv == shader::LOG2_BIAS);

}  // namespace

const std::vector<uint32_t>& center_weights() {
  // Made once: 256 powers take as long as a tenth of a small frame's metering.
  static const std::vector<uint32_t> weights = [] {
    constexpr uint32_t kSteps = 1u << shader::CENTER_STEPS_LOG2;
    std::vector<uint32_t> made(kSteps);
    for (uint32_t i = 0; i < kSteps; ++i) {
      made[i] = static_cast<uint32_t>(std::lround(255.0 * portable_exp(-2.0 * i / kSteps)));
    }
    return made;
  }();
  return weights;
}

double percentile_mean(std::span<const MeterBin> bins, double low_percent, double high_percent) {
  uint64_t total = 0;
  for (const MeterBin& bin : bins) total += bin.weight;
  const double low = low_percent / 100.0 * static_cast<double>(total);
  const double high = high_percent / 100.0 * static_cast<double>(total);
  double sum = 0.0;
  uint64_t below = 0;
  for (size_t i = 0; i < bins.size(); ++i) {
    const MeterBin& bin = bins[i];
    if (bin.weight == 0) continue;
    const auto weight = static_cast<double>(bin.weight);
    const double from = std::max(low, static_cast<double>(below));
    const double to = std::min(high, static_cast<double>(below) + weight);
    const double mean = static_cast<double>(i) / kBinsPerOctave - shader::LOG2_BIAS + bin.above_ev / weight;
    if (to > from) sum += (to - from) * mean;
    below += bin.weight;
  }
  CHECK(high > low);
  return sum / (high - low);
}

double scene_difference(const ScenePrint& a, const ScenePrint& b) {
  double sum = 0.0;
  double squares = 0.0;
  int cells = 0;
  for (size_t i = 0; i < a.size(); ++i) {
    const double difference = double{b[i]} - double{a[i]};
    if (std::isnan(difference)) continue;
    sum += difference;
    squares += difference * difference;
    ++cells;
  }
  if (cells == 0) return 0.0;
  const double mean = sum / cells;
  return std::sqrt(std::max(0.0, squares / cells - mean * mean));
}

double target_before_limits(const v1::Exposure& settings, double mean_log2_luminance) {
  if (settings.mode() == v1::Exposure::MODE_MANUAL) return portable_exp2(settings.manual_ev());
  return settings.key() * portable_exp2(settings.compensation_ev() - mean_log2_luminance);
}

double exposure_target(const v1::Exposure& settings, double mean_log2_luminance) {
  const double wanted = target_before_limits(settings, mean_log2_luminance);
  if (settings.mode() == v1::Exposure::MODE_MANUAL) return wanted;
  return std::clamp(wanted, settings.min_exposure(), settings.max_exposure());
}

absl::Status check_factor(const char* field, double factor) {
  // Written so that NaN fails.
  if (factor >= v1::kExposureLimit.min && factor <= v1::kExposureLimit.max) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrFormat("%s is %g; it must be between %g and %g", field, factor,
                                                    v1::kExposureLimit.min, v1::kExposureLimit.max));
}

absl::Status check_previous(const PreviousExposure& previous) {
  RETURN_IF_ERROR(check_factor("previous.exposure", previous.exposure));
  // Written so that NaN fails.
  if (!(previous.elapsed_seconds >= v1::kElapsedSeconds.min &&
        previous.elapsed_seconds <= v1::kElapsedSeconds.max)) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "previous.elapsed_seconds is %g; it must be between %g and %g: time does not run backwards",
        previous.elapsed_seconds, v1::kElapsedSeconds.min, v1::kElapsedSeconds.max));
  }
  return absl::OkStatus();
}

double adapt_exposure(const v1::Adaptation& settings, const std::optional<PreviousExposure>& previous,
                      double target) {
  if (!previous) return target;
  const double from = previous->exposure;
  const double speed = target > from ? settings.speed_up() : settings.speed_down();
  const double x = -previous->elapsed_seconds * speed;
  const bool linear = settings.domain() == v1::Adaptation::DOMAIN_LINEAR;
  // Computed from the nearer end, so that a short step keeps the digits of `previous` and a long one reaches
  // the target.
  if (x > -0.5) {
    const double alpha = -portable_expm1(x);
    return linear ? from + (target - from) * alpha
                  : from * portable_exp2(portable_log2(target / from) * alpha);
  }
  const double left = portable_exp(x);
  return linear ? target + (from - target) * left
                : target * portable_exp2(portable_log2(from / target) * left);
}

namespace {

double exposure_of(const v1::Exposure& settings, const std::optional<PreviousExposure>& previous,
                   bool metered, double target) {
  if (settings.mode() == v1::Exposure::MODE_MANUAL) return target;
  if (!metered && previous) return previous->exposure;
  return adapt_exposure(settings.adaptation(), previous, target);
}

}  // namespace

Exposed expose(const v1::Exposure& settings, const std::optional<PreviousExposure>& previous,
               std::optional<double> mean_log2_luminance, std::optional<double> given) {
  const double mean = mean_log2_luminance.value_or(kNothingMetered);
  const double target = exposure_target(settings, mean);
  const double wanted = target_before_limits(settings, mean);
  const double exposure =
      given ? *given : exposure_of(settings, previous, mean_log2_luminance.has_value(), target);
  // False for a NaN, too.
  CHECK(exposure >= v1::kExposureLimit.min && exposure <= v1::kExposureLimit.max);
  return {exposure, target, wanted};
}

}  // namespace candela
