#include "server/render/color/aces2_tone.h"

#include <algorithm>
#include <cmath>

#include "server/render/color/portable_math.h"

namespace candela::aces2 {
namespace {

// Viewing conditions: 100 nit of adaptation, a background of 20 %, a dim surround.
constexpr double kAdaptation = 100.0, kBackground = 20.0, kSurroundC = 0.59;

}  // namespace

const double kGamma = kSurroundC * (1.48 + std::sqrt(kBackground / kReference));
const double kAdaptedLight = [] {
  const double k4 = std::pow(1.0 / (5.0 * kAdaptation + 1.0), 4.0);
  return (0.2 * k4 * 5.0 * kAdaptation + 0.1 * std::pow(1.0 - k4, 2.0) * std::cbrt(5.0 * kAdaptation)) /
         kReference;
}();

double library_power(double x, double y) { return std::pow(x, y); }

double respond(double light, Power power) {
  const double p = power(std::abs(light) * kAdaptedLight, 0.42);
  return std::copysign(400.0 * p / (27.13 + p), light);
}
double light_of(double response, Power power) {
  const double r = std::abs(response);
  return std::copysign(power(27.13 * r / (400.0 - r), 1.0 / 0.42) / kAdaptedLight, response);
}

double J_of_response(double A) { return 100.0 * std::pow(A, kGamma); }
double response_of(double J) { return std::pow(J / 100.0, 1.0 / kGamma); }
double J_of(double nits) { return J_of_response(respond(nits) / respond(kReference)); }

ToneScale::ToneScale(double peak_nits) : g(1.15), t_1(0.04), log_peak(std::log10(peak_nits / kReference)) {
  const double peak = peak_nits / kReference;
  r_hit = 128.0 + (896.0 - 128.0) * log_peak / 2.0;
  const double m_1 = 0.5 * (peak + std::sqrt(peak * (peak + 4.0 * t_1)));
  const double u = std::pow((r_hit / m_1) / (r_hit / m_1 + 1.0), g);
  const double m = m_1 / u;
  c_t = 10.013 / kReference * (1.0 + std::log2(peak) * 0.14);
  const double g_ip = 0.5 * (c_t + std::sqrt(c_t * (c_t + 4.0 * t_1)));
  const double power = std::pow(g_ip / m, 1.0 / g);
  const double w_2 = 0.18 / -(m_1 * power / (power - 1.0));
  s_2 = w_2 * m_1 * kReference;
  m_2 = m_1 / std::pow((r_hit / m_1) / (r_hit / m_1 + w_2), g);
}

double ToneScale::response(double A, Power power) const {
  const double white = respond(kReference, power);
  const double nits = light_of(white * A, power);
  const double f = m_2 * power(nits / (nits + s_2), g);
  return respond(std::max(0.0, f * f / (f + t_1)) * kReference, power) / white;
}

}  // namespace candela::aces2
