// How a frame is to be rendered. The defaults are pipeline.md's; ranges are in proto/candela/v1/limits.h.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>

#include "absl/status/status.h"
#include "server/render/frame.h"

namespace candela {

// Values are those of the enums of the same name in candela.v1.
enum class ExposureMode : uint32_t { kAuto = 1, kManual = 2 };
enum class ToneCurve : uint32_t { kLinear = 1, kReinhard = 2, kAcesNarkowicz = 3, kAcesHill = 4 };
enum class Transfer : uint32_t { kSrgb = 1, kGamma22 = 2, kLinear = 3 };
enum class BadValues : uint32_t { kScrub = 1, kReject = 2 };

const char* name(ToneCurve curve);    // "aces-hill"
const char* name(Transfer transfer);  // "srgb"

struct ExposureSettings {
  ExposureMode mode = ExposureMode::kAuto;
  double manual_ev = 0.0;
  double compensation_ev = 0.0;
  double key = 0.18;
  double min_exposure = 1.0 / 64;
  double max_exposure = 64.0;
};

struct BloomSettings {
  float intensity = 0.05f;  // 0 is no bloom
  float threshold = 1.0f;   // scene luminance, before exposure
  float softness = 0.5f;    // knee as a fraction of the threshold
  uint32_t levels = 5;
  bool firefly_weights = true;
};

// CIE 1931 xy of the red, green and blue primaries and of white.
struct Chromaticities {
  std::array<double, 8> xy{};  // red x, red y, green x, ... white x, white y
};

struct Settings {
  ExposureSettings exposure;
  BloomSettings bloom;
  ToneCurve curve = ToneCurve::kAcesHill;
  double prescale = 1.0;
  Transfer transfer = Transfer::kSrgb;
  OutputFormat output_format = OutputFormat::kRgba8;
  BadValues bad_values = BadValues::kScrub;
  std::string tier = "standard";
  std::optional<Chromaticities> input_chromaticities;  // absent: Rec.709, D65
};

// INVALID_ARGUMENT naming the field, its value and its range; also for an unknown tier, listing those there
// are.
absl::Status check_settings(const Settings& settings);

}  // namespace candela
