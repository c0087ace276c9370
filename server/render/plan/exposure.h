// Exposure: a pure function on the host, in double (docs/pipeline.md section 3).
#pragma once

#include <optional>

#include "absl/status/status.h"
#include "server/render/settings/settings.h"

namespace candela {

// The factor that a frame of this mean log2 luminance asks for: key / 2^mean * 2^compensation within the
// limits, or 2^manual_ev. Finite and above 0 for settings that pass check_settings.
double exposure_target(const v1::Exposure& settings, double mean_log2_luminance);

// Where exposure was, and how much media time has passed since.
struct PreviousExposure {
  double exposure = 1.0;         // the factor E
  double elapsed_seconds = 0.0;  // 0 changes nothing
};

// What a frame is rendered with, and what its metering asked for: factors.
struct Exposed {
  double exposure = 1.0;
  double target = 1.0;

  bool operator==(const Exposed&) const = default;
};

// INVALID_ARGUMENT naming the field, its value and its range.
absl::Status check_previous(const PreviousExposure& previous);

// The factor on the way from `previous` to `target` (both above 0), 1 - exp(-elapsed * speed) of it in the
// domain that the settings name; `target` itself where there is no `previous`. Two steps to one target equal
// one step of their summed time within 1e-12, and never pass it.
double adapt_exposure(const v1::Adaptation& settings, const std::optional<PreviousExposure>& previous,
                      double target);

// The two together: MANUAL exposure does not adapt.
Exposed expose(const v1::Exposure& settings, const std::optional<PreviousExposure>& previous,
               double mean_log2_luminance);

}  // namespace candela
