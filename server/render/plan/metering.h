// What metering comes to, from what the device has summed (docs/pipeline.md section 2).
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace candela {

// The weight of each of the 256 steps of the squared distance to the centre, 0 .. 255.
std::vector<uint32_t> center_weights();

// A bin of the histogram of log2 luminance: its texels' weights, and the weighted sum of what they have above
// the bin's lower end, in EV.
struct MeterBin {
  uint64_t weight = 0;
  double above_ev = 0.0;
};

inline constexpr double kHistogramFirstEv = -14.0;
inline constexpr uint32_t kHistogramBinsPerEv = 64;

// The mean log2 luminance of the mass between two percentiles of the bins, which come in rising luminance
// from kHistogramFirstEv on; the two end bins count in proportion, each bin at its texels' mean. low < high;
// some weight is not 0.
double percentile_mean(std::span<const MeterBin> bins, double low_percent, double high_percent);

// The picture of a frame by which scenes are told apart: log2 luminance, in EV, over a grid of 8 x 8 cells,
// row by row. A cell is what its tiles meter; one without weight is NaN.
using ScenePrint = std::array<float, 64>;

// How much two pictures differ, whatever brightness they differ by as a whole: the standard deviation of
// their cells' differences in EV, over the cells that both have; 0 where they share none.
double scene_difference(const ScenePrint& a, const ScenePrint& b);

}  // namespace candela
