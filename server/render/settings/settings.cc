#include "server/render/settings/settings.h"

#include <cmath>

#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "proto/candela/v1/limits.h"
#include "server/render/color/primaries.h"
#include "server/render/settings/tiers.h"

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

absl::Status check_table(const Settings& settings) {
  if (settings.curve == ToneCurve::kTable && !settings.table) {
    return absl::InvalidArgumentError(
        "curve is TABLE and there is no table; send one, or choose another curve");
  }
  if (!settings.table) return absl::OkStatus();
  if (settings.curve != ToneCurve::kTable) {
    return absl::InvalidArgumentError(
        absl::StrFormat("there is a table and curve is %s; set curve to TABLE, or leave the table out",
                        name(settings.curve)));
  }
  const ColorTable& table = *settings.table;
  absl::Status status = in_range("table.size", table.size, v1::kTableSize);
  if (table.axes != shader::AXES_ACES && table.axes != shader::AXES_REC709) {
    return absl::InvalidArgumentError(
        absl::StrFormat("table.axes is %d; it must be ACES (1) or REC709 (2)", table.axes));
  }
  status.Update(in_range("table.end", table.end, v1::kTableEnd));
  const uint64_t values = uint64_t{table.size} * table.size * table.size * 3;
  if (status.ok() && table.values.size() != values) {
    return absl::InvalidArgumentError(
        absl::StrFormat("table.values is %d bytes; %d^3 points of 6 bytes are %d",
                        table.values.size() * sizeof(uint16_t), table.size, values * sizeof(uint16_t)));
  }
  return status;
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
    case ToneCurve::kAces1:
      return "aces-1";
    case ToneCurve::kTable:
      return "table";
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

Transfer output_transfer(const Settings& settings) {
  if (settings.curve == ToneCurve::kTable) return Transfer::kSrgb;
  return settings.output_format == OutputFormat::kRgba16f ? Transfer::kLinear : settings.transfer;
}

absl::Status check_settings(const Settings& settings) {
  const ExposureSettings& exposure = settings.exposure;
  const MeteringSettings& metering = exposure.metering;
  const BloomSettings& bloom = settings.bloom;
  for (const absl::Status& status : {
           in_range("exposure.manual_ev", exposure.manual_ev, v1::kManualEv),
           in_range("exposure.compensation_ev", exposure.compensation_ev, v1::kCompensationEv),
           in_range("exposure.key", exposure.key, v1::kKey),
           in_range("exposure.min_exposure", exposure.min_exposure, v1::kExposureLimit),
           in_range("exposure.max_exposure", exposure.max_exposure, v1::kExposureLimit),
           in_range("exposure.metering.percentile_low", metering.percentile_low, v1::kPercentile),
           in_range("exposure.metering.percentile_high", metering.percentile_high, v1::kPercentile),
           in_range("exposure.adaptation.speed_up", exposure.adaptation.speed_up, v1::kAdaptationSpeed),
           in_range("exposure.adaptation.speed_down", exposure.adaptation.speed_down, v1::kAdaptationSpeed),
           in_range("bloom.intensity", bloom.intensity,
                    bloom.kind == BloomKind::kConserve ? v1::kConserveIntensity : v1::kBloomIntensity),
           in_range("bloom.threshold", bloom.threshold, v1::kBloomThreshold),
           in_range("bloom.softness", bloom.softness, v1::kBloomSoftness),
           in_range("bloom.levels", bloom.levels, v1::kBloomLevels),
           in_range("max_error_codes", settings.promise.max_error_codes.value_or(0), v1::kMaxErrorCodes),
           in_range("max_ms", settings.promise.max_ms.value_or(1), v1::kMaxMs),
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
  if (metering.percentile_high - metering.percentile_low < v1::kLeastPercentileRange) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "exposure.metering.percentile_low is %g and percentile_high is %g; the low one must be smaller by %g "
        "or more",
        metering.percentile_low, metering.percentile_high, v1::kLeastPercentileRange));
  }
  if (const Rectangle& spot = metering.spot;
      metering.weights == MeterWeights::kSpot && (spot.x0 >= spot.x1 || spot.y0 >= spot.y1)) {
    return absl::InvalidArgumentError(
        absl::StrFormat("exposure.metering.spot is x %d .. %d, y %d .. %d and holds no pixel; x0 must be "
                        "below x1 and y0 below y1",
                        spot.x0, spot.x1, spot.y0, spot.y1));
  }
  if (find_tier(settings.tier) == nullptr) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "tier is \"%s\"; there are: %s", settings.tier,
        absl::StrJoin(tiers(), ", ", [](std::string* out, const Tier& tier) { out->append(tier.name); })));
  }
  if (absl::Status status = check_table(settings); !status.ok()) return status;
  if (settings.input_chromaticities) {
    return matrix_to_rec709(*settings.input_chromaticities).status();
  }
  return absl::OkStatus();
}

absl::Status check_settings_for(const Settings& settings, const FrameDesc& desc) {
  const MeteringSettings& metering = settings.exposure.metering;
  if (metering.weights == MeterWeights::kSpot &&
      (metering.spot.x0 >= desc.width || metering.spot.y0 >= desc.height)) {
    return absl::InvalidArgumentError(
        absl::StrFormat("exposure.metering.spot begins at x %d, y %d, beside the frame of %dx%d pixels",
                        metering.spot.x0, metering.spot.y0, desc.width, desc.height));
  }
  return absl::OkStatus();
}

}  // namespace candela
