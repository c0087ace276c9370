// Metering and exposure: from a frame's tiles to a step of its exposure.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "absl/status/status.h"
#include "proto/candela/v1/limits.h"
#include "server/render/settings/settings.h"
#include "shaders/params.h"

namespace candela {

// Metering, from the sums that the passes made (docs/pipeline.md section 2).

// Weights (0 .. 255) of the 256 steps of squared distance from the centre. Any thread.
const std::vector<uint32_t>& center_weights();

// A bin of the histogram of log2 luminance: the sum of its texels' weights, and the weighted sum of their
// distances above the bin's lower end, in EV.
struct MeterBin {
  uint64_t weight = 0;
  double above_ev = 0.0;
};

// The number of bins. With the scrub luminance is up to 2^30.
constexpr uint32_t histogram_bins(bool scrub) {
  return scrub ? shader::HISTOGRAM_SCRUB_BINS : shader::HISTOGRAM_BINS;
}

inline constexpr double kHistogramFirstEv = -14.0;
inline constexpr uint32_t kHistogramBinsPerEv = 64;

// The mean log2 luminance of a frame with nothing metered: log2 0.18.
inline constexpr double kNothingMetered = v1::kNothingMetered;

// The mean log2 luminance between two percentiles of the weight. The bins are in rising luminance from
// kHistogramFirstEv on. Each bin counts with its texels' mean, and the two end bins count in proportion. low
// < high; some weight is not 0.
double percentile_mean(std::span<const MeterBin> bins, double low_percent, double high_percent);

// A coarse picture of a frame, which tells scenes apart: the log2 luminance, in EV, of a grid of 8 x 8 cells,
// row by row. A cell is the metered mean of its tiles; a cell without weight is NaN.
using ScenePrint = std::array<float, 64>;

// The difference of two pictures apart from their overall brightness: the standard deviation of their cells'
// differences in EV, over the cells that both have; 0 if they share none.
double scene_difference(const ScenePrint& a, const ScenePrint& b);

// Exposure as pure functions, in double (docs/pipeline.md section 3).

// The factor that suits a frame of this mean log2 luminance: key / 2^mean * 2^compensation within the limits,
// or 2^manual_ev. It is finite and above 0 for settings that passed Settings::from.
double exposure_target(const v1::Exposure& settings, double mean_log2_luminance);
// The same without the limits min_exposure and max_exposure.
double target_before_limits(const v1::Exposure& settings, double mean_log2_luminance);

// The exposure of the frame before, and the media time that has passed since then.
struct PreviousExposure {
  double exposure = 1.0;         // the factor E
  double elapsed_seconds = 0.0;  // 0 changes nothing
};

// The factor that a frame is rendered with, and the factor that its metering chose.
struct Exposed {
  double exposure = 1.0;
  double target = 1.0;
  // The target without the limits; 0 if unknown, as after a resumption. Nothing follows from it.
  double target_before_limits = 0.0;

  bool operator==(const Exposed& other) const { return exposure == other.exposure && target == other.target; }
};

// INVALID_ARGUMENT naming `field`, its value and its range unless it is a factor that a client may give.
absl::Status check_factor(const char* field, double factor);

// INVALID_ARGUMENT naming the field, its value and its range.
absl::Status check_previous(const PreviousExposure& previous);

// Moves the factor from `previous` towards `target` (both above 0): by 1 - exp(-elapsed * speed) of the way,
// in the domain that the settings name. Without a `previous` it is `target` at once. Two steps towards one
// target equal one step of their summed time within 1e-12, and never pass the target.
double adapt_exposure(const v1::Adaptation& settings, const std::optional<PreviousExposure>& previous,
                      double target);

// Both together. Manual exposure does not adapt. Without a mean nothing is metered: the frame keeps the
// factor of `previous`, or takes its target; the target is that of a mean of log2 0.18. A `given` factor
// replaces the exposure, not the target.
Exposed expose(const v1::Exposure& settings, const std::optional<PreviousExposure>& previous,
               std::optional<double> mean_log2_luminance, std::optional<double> given = std::nullopt);

}  // namespace candela
