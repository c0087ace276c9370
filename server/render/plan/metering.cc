#include "server/render/plan/metering.h"

#include <algorithm>
#include <cmath>

#include "server/base/check.h"
#include "server/render/color/portable_math.h"
#include "shaders/params.h"

namespace candela {

namespace {

constexpr double kBinsPerOctave = 1u << (shader::LOG2_FRACTION_BITS - shader::HISTOGRAM_SHIFT);
static_assert(kBinsPerOctave == kHistogramBinsPerEv && -kHistogramFirstEv == shader::LOG2_BIAS);

}  // namespace

std::vector<uint32_t> center_weights() {
  constexpr uint32_t kSteps = 1u << shader::CENTER_STEPS_LOG2;
  std::vector<uint32_t> weights(kSteps);
  for (uint32_t i = 0; i < kSteps; ++i) {
    weights[i] = static_cast<uint32_t>(std::lround(255.0 * portable_exp(-2.0 * i / kSteps)));
  }
  return weights;
}

double percentile_mean(std::span<const MeterBin> bins, double low_percent, double high_percent) {
  uint64_t total = 0;
  for (const MeterBin& bin : bins) total += bin.weight;
  const double low = low_percent / 100.0 * static_cast<double>(total);
  const double high = high_percent / 100.0 * static_cast<double>(total);
  double sum = 0.0;
  uint64_t below = 0;
  for (size_t i = 0; i < bins.size(); ++i) {
    const MeterBin& bin = bins[i];
    if (bin.weight == 0) continue;
    const auto weight = static_cast<double>(bin.weight);
    const double from = std::max(low, static_cast<double>(below));
    const double to = std::min(high, static_cast<double>(below) + weight);
    const double mean = static_cast<double>(i) / kBinsPerOctave - shader::LOG2_BIAS + bin.above_ev / weight;
    if (to > from) sum += (to - from) * mean;
    below += bin.weight;
  }
  CHECK(high > low);
  return sum / (high - low);
}

double scene_difference(const ScenePrint& a, const ScenePrint& b) {
  double sum = 0.0;
  double squares = 0.0;
  int cells = 0;
  for (size_t i = 0; i < a.size(); ++i) {
    const double difference = double{b[i]} - double{a[i]};
    if (std::isnan(difference)) continue;
    sum += difference;
    squares += difference * difference;
    ++cells;
  }
  if (cells == 0) return 0.0;
  const double mean = sum / cells;
  return std::sqrt(std::max(0.0, squares / cells - mean * mean));
}

}  // namespace candela
