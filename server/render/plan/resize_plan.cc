#include "server/render/plan/resize_plan.h"

#include <algorithm>
#include <cstdlib>
#include <numbers>

#include "absl/strings/str_cat.h"

namespace candela {

namespace {

constexpr uint32_t kLobes = 3;

// sin(pi x) for 0 <= x <= 1: its series, within 3e-16. A library's last digit depends on the processor.
double sine_of_pi(double x) {
  x = std::min(x, 1 - x);
  const double y = std::numbers::pi * x;
  const double square = y * y;
  double sum = 1;
  for (int n = 19; n > 1; n -= 2) sum = 1 - square / (n * (n - 1)) * sum;
  return y * sum;
}

// sinc(pi t) sinc(pi t / 3) for t = distance / unit, |t| < 3.
double lanczos(int64_t distance, int64_t unit) {
  if (distance == 0) return 1;
  if (distance % unit == 0) return 0;
  constexpr double kPiSquared = 9.86960440108935861883;
  const double t = static_cast<double>(std::abs(distance)) / static_cast<double>(unit);
  const double third = sine_of_pi(t / kLobes);
  return kLobes * third * third * (3 - 4 * third * third) /
         (kPiSquared * t * t);  // sin 3a = sin a (3 - 4 sin^2 a)
}

// A distance of one from a texel's centre to an output's, and the distance of texel k from output i.
int64_t unit_of(const AxisFilter& filter) { return 2 * int64_t{std::max(filter.from, filter.to)}; }
int64_t distance(const AxisFilter& filter, uint32_t k, uint32_t i) {
  return (2 * int64_t{k} + 1) * filter.to - (2 * int64_t{i} + 1) * filter.from;
}

// The texels that are nearer than `lobes` units.
TexelRange within(const AxisFilter& filter, uint32_t i, uint32_t lobes) {
  const int64_t step = 2 * int64_t{filter.to};
  const int64_t reach = lobes * unit_of(filter);
  const int64_t below =
      -distance(filter, 0, i) - reach;  // the first texel is beyond this distance from texel 0
  const int64_t above = -distance(filter, 0, i) + reach;  // the last one is below this one
  const int64_t first = below < 0 ? 0 : below / step + 1;
  const int64_t last = (above - 1) / step + 1;
  return {static_cast<uint32_t>(first), static_cast<uint32_t>(std::min<int64_t>(last, filter.from))};
}

}  // namespace

TexelRange AxisFilter::texels(uint32_t i) const {
  return mean > 0 ? TexelRange{i * mean, (i + 1) * mean} : within(*this, i, kLobes);
}

TexelRange AxisFilter::main_lobe(uint32_t i) const { return mean > 0 ? texels(i) : within(*this, i, 1); }

std::string AxisFilter::words() const {
  return mean == 0 ? "Lanczos" : mean == 1 ? "as it is" : absl::StrCat("mean of ", mean);
}

uint32_t most_taps(uint32_t from, uint32_t to) {
  if (from % to == 0) return from / to;
  const uint32_t reach = 2 * kLobes;  // units of max(from, to) / to texels
  return (reach * std::max(from, to) - 1) / to + 1;
}

AxisFilter axis_filter(uint32_t from, uint32_t to) {
  AxisFilter filter;
  filter.from = from;
  filter.to = to;
  filter.taps = most_taps(from, to);
  if (from % to == 0) {
    filter.mean = filter.taps;
    return filter;
  }
  filter.weights.resize(size_t{to} * filter.taps);
  const int64_t unit = unit_of(filter);
  std::vector<double> row(filter.taps);
  for (uint32_t i = 0; i < to; ++i) {
    const TexelRange range = filter.texels(i);
    double sum = 0;
    for (uint32_t k = range.first; k < range.last; ++k) {
      row[k - range.first] = lanczos(distance(filter, k, i), unit);
      sum += row[k - range.first];
    }
    float* const weights = filter.weights.data() + size_t{i} * filter.taps;
    for (uint32_t k = 0; k < range.last - range.first; ++k) weights[k] = static_cast<float>(row[k] / sum);
  }
  return filter;
}

}  // namespace candela
