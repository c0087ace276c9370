// How a frame is to be rendered. Ranges and defaults are in proto/candela/v1/limits.h.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "absl/status/status.h"
#include "proto/candela/v1/limits.h"
#include "server/render/color/primaries.h"
#include "server/render/settings/frame.h"
#include "shaders/color_table.h"

namespace candela {

// Values are those of the enums of the same name in candela.v1.
enum class ExposureMode : uint32_t { kAuto = 1, kManual = 2 };
enum class MeterStatistic : uint32_t { kLogAverage = 1, kPercentile = 2 };
enum class MeterWeights : uint32_t { kAverage = 1, kCenter = 2, kSpot = 3 };
enum class AdaptationDomain : uint32_t { kLinear = 1, kLog = 2 };
enum class BloomKind : uint32_t { kMip = 1, kConserve = 2, kGaussian = 3 };
enum class ToneCurve : uint32_t {
  kLinear = 1,
  kReinhard = 2,
  kAcesNarkowicz = 3,
  kAcesHill = 4,
  kReinhardExtended = 5,
  kHable = 6,
  kAgx = 7,
  kPbrNeutral = 8,
  kAces1 = 9,
  kTable = 10
};
enum class Transfer : uint32_t { kSrgb = 1, kGamma22 = 2, kLinear = 3 };
enum class BadValues : uint32_t { kScrub = 1, kReject = 2 };

const char* name(ToneCurve curve);    // "aces-hill"
const char* name(Transfer transfer);  // "srgb"

// Pixels with x0 <= x < x1 and y0 <= y < y1.
struct Rectangle {
  uint32_t x0 = 0;
  uint32_t y0 = 0;
  uint32_t x1 = 0;
  uint32_t y1 = 0;
};

struct MeteringSettings {
  MeterStatistic statistic = MeterStatistic::kLogAverage;
  double percentile_low = v1::kDefaultPercentileLow;    // percent
  double percentile_high = v1::kDefaultPercentileHigh;  // percent
  MeterWeights weights = MeterWeights::kAverage;
  Rectangle spot;          // of kSpot
  bool histogram = false;  // wanted among the frame's statistics
};

struct AdaptationSettings {
  AdaptationDomain domain = AdaptationDomain::kLog;
  double speed_up = v1::kDefaultSpeedUp;      // per second, while exposure rises
  double speed_down = v1::kDefaultSpeedDown;  // per second, while it falls
};
struct Settings;

// What resolve encodes with: none for display-linear output, and for a client's own table always the curve by
// which its values became light.
Transfer output_transfer(const Settings& settings);

struct ExposureSettings {
  ExposureMode mode = ExposureMode::kAuto;
  double manual_ev = v1::kDefaultManualEv;
  double compensation_ev = v1::kDefaultCompensationEv;
  double key = v1::kDefaultKey;
  double min_exposure = v1::kDefaultMinExposure;
  double max_exposure = v1::kDefaultMaxExposure;
  MeteringSettings metering;
  AdaptationSettings adaptation;
};

struct BloomSettings {
  BloomKind kind = BloomKind::kMip;
  float intensity = v1::kDefaultBloomIntensity;  // 0 is no bloom
  float threshold = v1::kDefaultBloomThreshold;  // scene luminance; of kGaussian times 2^(metered mean)
  float softness = v1::kDefaultBloomSoftness;    // knee as a fraction of the threshold
  uint32_t levels = v1::kDefaultBloomLevels;
  bool firefly_weights = v1::kDefaultFireflyWeights;
};

// What a tier has to keep; with neither, the settings' own tier is taken.
struct Promise {
  std::optional<double> max_error_codes;
  std::optional<double> max_ms;

  bool given() const { return max_error_codes || max_ms; }
};

struct Settings {
  ExposureSettings exposure;
  BloomSettings bloom;
  ToneCurve curve = ToneCurve::kAcesHill;
  float curve_white = v1::kDefaultCurveWhite;  // exposed luminance that reinhard-extended maps to 1
  double prescale = v1::kDefaultPrescale;
  Transfer transfer = Transfer::kSrgb;
  OutputFormat output_format = OutputFormat::kRgba8;
  BadValues bad_values = BadValues::kScrub;
  std::string tier = v1::kDefaultTier;
  Promise promise;  // chooses the tier, see tier_choice.h
  bool dither = false;
  std::optional<Chromaticities> input_chromaticities;  // absent: Rec.709, D65
  std::shared_ptr<const ColorTable> table;             // of kTable, and only there
};

// INVALID_ARGUMENT naming the field, its value and its range; also for an unknown tier, listing those there
// are.
absl::Status check_settings(const Settings& settings);

// INVALID_ARGUMENT where the settings do not fit this frame: a spot that lies beside it.
absl::Status check_settings_for(const Settings& settings, const FrameDesc& desc);

}  // namespace candela
