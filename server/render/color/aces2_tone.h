// What ACES 2.0 does to grey: the response of a cone to light, lightness, and the tone scale. Internal to
// server/render/color. Any thread.
#pragma once

namespace candela::aces2 {

inline constexpr double kReference = 100.0;  // nit of 1.0, and of the white of the appearance space
extern const double kGamma;                  // of lightness over the achromatic response
extern const double kAdaptedLight;           // of 1 nit, in the cones' unit

// x^y for x >= 0 and y > 0: the C library's, or candela::portable_power().
using Power = double (*)(double x, double y);
double library_power(double x, double y);

// The response of a cone to light in nit, and back.
double respond(double light, Power power = library_power);
double light_of(double response, Power power = library_power);

// Lightness of an achromatic response, which is 1 for 100 nit, and back; and of grey of so many nit.
double J_of_response(double A);
double response_of(double J);
double J_of(double nits);

struct ToneScale {
  explicit ToneScale(double peak_nits);

  // The display's achromatic response to the scene's.
  double response(double A, Power power) const;
  // The same for lightness.
  double operator()(double J) const { return J_of_response(response(response_of(J), library_power)); }

  double g, t_1, c_t, s_2, m_2, r_hit, log_peak;
};

}  // namespace candela::aces2
