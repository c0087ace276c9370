// How a frame is to be rendered. Ranges and defaults are in proto/candela/v1/limits.h.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>

#include "absl/status/status.h"
#include "proto/candela/v1/limits.h"
#include "server/render/frame.h"

namespace candela {

// Values are those of the enums of the same name in candela.v1.
enum class ExposureMode : uint32_t { kAuto = 1, kManual = 2 };
enum class ToneCurve : uint32_t {
  kLinear = 1,
  kReinhard = 2,
  kAcesNarkowicz = 3,
  kAcesHill = 4,
  kReinhardExtended = 5,
  kHable = 6,
  kAgx = 7,
  kPbrNeutral = 8
};
enum class Transfer : uint32_t { kSrgb = 1, kGamma22 = 2, kLinear = 3 };
enum class BadValues : uint32_t { kScrub = 1, kReject = 2 };

const char* name(ToneCurve curve);    // "aces-hill"
const char* name(Transfer transfer);  // "srgb"

struct ExposureSettings {
  ExposureMode mode = ExposureMode::kAuto;
  double manual_ev = v1::kDefaultManualEv;
  double compensation_ev = v1::kDefaultCompensationEv;
  double key = v1::kDefaultKey;
  double min_exposure = v1::kDefaultMinExposure;
  double max_exposure = v1::kDefaultMaxExposure;
};

struct BloomSettings {
  float intensity = v1::kDefaultBloomIntensity;  // 0 is no bloom
  float threshold = v1::kDefaultBloomThreshold;  // scene luminance, before exposure
  float softness = v1::kDefaultBloomSoftness;    // knee as a fraction of the threshold
  uint32_t levels = v1::kDefaultBloomLevels;
  bool firefly_weights = v1::kDefaultFireflyWeights;
};

// CIE 1931 xy of the red, green and blue primaries and of white.
struct Chromaticities {
  std::array<double, 8> xy{};  // red x, red y, green x, ... white x, white y
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
  std::optional<Chromaticities> input_chromaticities;  // absent: Rec.709, D65
};

// INVALID_ARGUMENT naming the field, its value and its range; also for an unknown tier, listing those there
// are.
absl::Status check_settings(const Settings& settings);

}  // namespace candela
