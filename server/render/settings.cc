#include "server/render/settings.h"

#include <cmath>

#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "proto/candela/v1/limits.h"
#include "server/render/primaries.h"
#include "server/render/tiers.h"

namespace candela {

namespace {

// Also refuses NaN.
template <typename T, typename R>
absl::Status in_range(const char* field, T value, const v1::Range<R>& range) {
  if (value >= range.min && value <= range.max) return absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrFormat("%s is %g; it must be between %g and %g", field, static_cast<double>(value),
                      static_cast<double>(range.min), static_cast<double>(range.max)));
}

}  // namespace

const char* name(ToneCurve curve) {
  switch (curve) {
    case ToneCurve::kLinear:
      return "linear";
    case ToneCurve::kReinhard:
      return "reinhard";
    case ToneCurve::kAcesNarkowicz:
      return "aces-narkowicz";
    case ToneCurve::kAcesHill:
      return "aces-hill";
    case ToneCurve::kReinhardExtended:
      return "reinhard-extended";
    case ToneCurve::kHable:
      return "hable";
    case ToneCurve::kAgx:
      return "agx";
    case ToneCurve::kPbrNeutral:
      return "pbr-neutral";
  }
  return "unknown";
}

const char* name(Transfer transfer) {
  switch (transfer) {
    case Transfer::kSrgb:
      return "srgb";
    case Transfer::kGamma22:
      return "gamma22";
    case Transfer::kLinear:
      return "linear";
  }
  return "unknown";
}

absl::Status check_settings(const Settings& settings) {
  const ExposureSettings& exposure = settings.exposure;
  const BloomSettings& bloom = settings.bloom;
  for (const absl::Status& status : {
           in_range("exposure.manual_ev", exposure.manual_ev, v1::kManualEv),
           in_range("exposure.compensation_ev", exposure.compensation_ev, v1::kCompensationEv),
           in_range("exposure.key", exposure.key, v1::kKey),
           in_range("exposure.min_exposure", exposure.min_exposure, v1::kExposureLimit),
           in_range("exposure.max_exposure", exposure.max_exposure, v1::kExposureLimit),
           in_range("bloom.intensity", bloom.intensity, v1::kBloomIntensity),
           in_range("bloom.threshold", bloom.threshold, v1::kBloomThreshold),
           in_range("bloom.softness", bloom.softness, v1::kBloomSoftness),
           in_range("bloom.levels", bloom.levels, v1::kBloomLevels),
           in_range("prescale", settings.prescale, v1::kPrescale),
           in_range("curve_white", settings.curve_white, v1::kCurveWhite),
       }) {
    if (!status.ok()) return status;
  }
  if (exposure.min_exposure > exposure.max_exposure) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "exposure.min_exposure is %g and exposure.max_exposure is %g; the minimum must not be larger",
        exposure.min_exposure, exposure.max_exposure));
  }
  if (find_tier(settings.tier) == nullptr) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "tier is \"%s\"; there are: %s", settings.tier,
        absl::StrJoin(tiers(), ", ", [](std::string* out, const Tier& tier) { out->append(tier.name); })));
  }
  if (settings.input_chromaticities) {
    return matrix_to_rec709(*settings.input_chromaticities).status();
  }
  return absl::OkStatus();
}

}  // namespace candela
