#include "server/render/color/hdr_signal.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "server/base/check.h"
#include "server/render/color/portable_math.h"

namespace candela {

double pq_signal(double light) {
  const double y = portable_power(light, 2610.0 / 16384);
  return portable_power((3424.0 / 4096 + 2413.0 / 128 * y) / (1 + 2392.0 / 128 * y), 2523.0 / 32);
}

double pq_light(double signal) {
  const double p = portable_power(signal, 32.0 / 2523);
  const double y = std::max(p - 3424.0 / 4096, 0.0) / (2413.0 / 128 - 2392.0 / 128 * p);
  return portable_power(y, 16384.0 / 2610);
}

double hlg_exponent(double peak_nits) {
  const double gamma = 1.2 + 0.42 * portable_log2(peak_nits / 1000) / portable_log2(10);
  return (1 - gamma) / gamma;
}

namespace {

// Greys among which the steepest is sought.
constexpr double kLeastGrey = 0x1p-14, kMostGrey = 0x1p8;
constexpr int kGreysPerOctave = 64;
constexpr double kLeastMaxLog2 = 1.0 / 64;

// BT.2390's roll-off of light in nit from a source's peak to a display's.
double rolled_off(double nits, double source_nits, double peak_nits) {
  const double source = pq_signal(source_nits / kPqPeakNits);
  const double most = pq_signal(peak_nits / kPqPeakNits) / source;
  const double knee = 1.5 * most - 0.5;
  const double e = pq_signal(std::min(nits, source_nits) / kPqPeakNits) / source;
  if (e < knee || most >= 1) return std::min(nits, peak_nits);
  const double t = (e - knee) / (1 - knee);
  const double bent = (2 * t * t * t - 3 * t * t + 1) * knee + (t * t * t - 2 * t * t + t) * (1 - knee) +
                      (-2 * t * t * t + 3 * t * t) * most;
  return pq_light(bent * source) * kPqPeakNits;
}

// Where piece i of the table begins.
double begin_of(uint32_t i) {
  constexpr int kPerOctave = 1 << (23 - shader::GAIN_SHIFT);
  const double mantissa = 1.0 + static_cast<double>(i % kPerOctave) / kPerOctave;
  return std::ldexp(shader::GAIN_KNEE * mantissa, static_cast<int>(i / kPerOctave)) - shader::GAIN_KNEE;
}

}  // namespace

GainCurve::GainCurve(const std::function<Rgb(const Rgb&)>& tone_curve, double source_nits, double peak_nits)
    : grey_([tone_curve](double n) {
        const Rgb y = tone_curve({n, n, n});
        return std::clamp(0.2126 * y[0] + 0.7152 * y[1] + 0.0722 * y[2], 0.0, 1.0);
      }),
      source_(source_nits / kReferenceWhiteNits),
      peak_(peak_nits / kReferenceWhiteNits) {
  CHECK(peak_nits >= kReferenceWhiteNits && peak_nits <= kPqPeakNits);
  CHECK(source_nits >= kReferenceWhiteNits && source_nits <= kPqPeakNits);
  steepest_ = 0;
  const double step = portable_exp2(1.0 / kGreysPerOctave);
  const double black = grey_(0);  // a film's is above 0
  for (double n = kLeastGrey; n <= kMostGrey; n *= step) {
    if (const double steep = (grey_(n) - black) / n; steep > steepest_) {
      steepest_ = steep;
      shoulder_ = n;
    }
  }
  // A curve that still rises where the roll-off has ended has its largest gain before the end.
  max_log2_ = std::max(kLeastMaxLog2, log2_gain(shader::GAIN_END));
  for (double n = shoulder_; n < shader::GAIN_END; n *= step) max_log2_ = std::max(max_log2_, log2_gain(n));
  pieces_ = make_pieces();
}

double GainCurve::gain_at(double n) const {
  const double sdr = grey_(n);
  if (n <= shoulder_ || sdr <= 0) return 1;
  const double nits = rolled_off(steepest_ * n * kReferenceWhiteNits, source_ * kReferenceWhiteNits,
                                 peak_ * kReferenceWhiteNits);
  return std::max(1.0, nits / kReferenceWhiteNits / sdr);
}

double GainCurve::log2_gain(double n) const {
  return portable_log2(gain_at(std::clamp<double>(n, 0, shader::GAIN_END)));
}

std::shared_ptr<const ColorTable> GainCurve::make_pieces() const {
  const auto code = [this](double n) { return std::min(log2_gain(n) / max_log2_, 1.0); };
  const auto slope = [&](double n) {
    const double step = 1e-4 * (n + shader::GAIN_KNEE);
    return (code(n + step) - code(std::max(n - step, 0.0))) / (step + std::min(step, n));
  };
  ColorTable table;
  double y0 = code(0), m0 = slope(0);
  for (uint32_t i = 0; i < shader::GAIN_PIECES; ++i) {
    const double width = begin_of(i + 1) - begin_of(i);
    const double y1 = code(begin_of(i + 1)), m1 = slope(begin_of(i + 1));
    const double c2 = 3 * (y1 - y0) - (2 * m0 + m1) * width, c3 = 2 * (y0 - y1) + (m0 + m1) * width;
    table.elements.push_back({static_cast<float>(y0), static_cast<float>(m0 * width), static_cast<float>(c2),
                              static_cast<float>(c3)});
    y0 = y1;
    m0 = m1;
  }
  return std::make_shared<const ColorTable>(std::move(table));
}

}  // namespace candela
