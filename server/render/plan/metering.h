// Metering on the host, from the sums that the device made (docs/pipeline.md section 2).
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "proto/candela/v1/limits.h"
#include "shaders/params.h"

namespace candela {

// Weights (0 .. 255) of the 256 steps of squared distance from the centre.
std::vector<uint32_t> center_weights();

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

}  // namespace candela
