#include "server/render/plan/exposure.h"

#include <algorithm>

#include "absl/strings/str_format.h"
#include "proto/candela/v1/limits.h"
#include "server/base/check.h"
#include "server/base/status_macros.h"
#include "server/render/color/portable_math.h"
#include "server/render/plan/metering.h"

namespace candela {

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
