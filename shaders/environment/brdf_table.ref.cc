// Twin of brdf_table.comp: the split sum's second factor by the tanh-sinh rule. The shader uses
// another quadrature.
//
// With v = (sin, 0, n.v) and h at the angle theta from n and phi around it, tan theta = alpha tan psi makes
// D n.h dh = 2 sin psi cos psi dpsi dphi / (2 pi). The light direction l = reflect(-v, h) is above the
// horizon while n.l = R cos(2 theta - delta) > 0 with tan delta = sin cos phi / n.v, so for
// theta < (delta + pi/2) / 2. The integrand is smooth up to that limit. For a small n.v it bends sharply at
// both ends of theta and at phi = pi/2, where the points of the rule lie densest. Twice as many points change
// nothing by more than 1e-7 for n.v >= 0.001.
#include <cmath>

#include "shaders/environment/environment.h"

namespace candela::reference {

namespace {

constexpr size_t kPoints = 48;

struct Point {
  double x = 0.0;  // 0 .. 1
  double weight = 0.0;
};
using Rule = std::array<Point, kPoints>;

// The tanh-sinh rule for integrals from 0 to 1: with x = 1 / (1 + exp(-pi sinh u)), the midpoint rule in u.
// Its points crowd towards both ends.
Rule make_rule() {
  constexpr double kReach = 3.0;  // beyond it the weights are under 1e-12
  constexpr double kStep = 2.0 * kReach / kPoints;
  Rule rule;
  for (size_t i = 0; i < kPoints; ++i) {
    const double u = kStep * (static_cast<double>(i) + 0.5) - kReach;
    const double e = std::exp(-kPi * std::sinh(u));
    rule[i] = {1.0 / (1.0 + e), kStep * kPi * std::cosh(u) * e / ((1.0 + e) * (1.0 + e))};
  }
  return rule;
}

double visibility(double nol, double nov, double alpha) {
  const double a2 = alpha * alpha;
  const double view = nol * std::sqrt(nov * nov * (1.0 - a2) + a2);
  const double light = nov * std::sqrt(nol * nol * (1.0 - a2) + a2);
  return 0.5 / (view + light);
}

// Adds the light that is reflected at h, which stands for `weight` of D n.h dh.
void add_reflection(const Direction& v, const Direction& h, double alpha, double weight, BrdfSum* sum) {
  const double voh = dot(v, h);
  const double nol = 2.0 * voh * h[2] - v[2];
  if (nol <= 0.0 || voh <= 0.0) return;
  const double part = weight * visibility(nol, v[2], alpha) * nol * 4.0 * voh / h[2];
  const double fc = std::pow(1.0 - voh, 5.0);
  sum->scale += part * (1.0 - fc);
  sum->bias += part * fc;
}

}  // namespace

BrdfSum brdf_sum(double nov, double roughness) {
  const double alpha = roughness * roughness;
  const Direction v = {std::sqrt(1.0 - nov * nov), 0.0, nov};
  static const Rule rule = make_rule();
  BrdfSum sum;
  // The half phi > pi mirrors the half phi < pi, which has its weight.
  for (int side = 0; side < 2; ++side) {
    for (const Point& at_phi : rule) {
      const double phi = kPi / 2.0 * (side + at_phi.x);
      const double delta = std::atan2(v[0] * std::cos(phi), nov);
      const double limit = std::atan2(std::tan((delta + kPi / 2.0) / 2.0), alpha);
      for (const Point& at_psi : rule) {
        const double psi = limit * at_psi.x;
        const double theta = std::atan(alpha * std::tan(psi));
        const Direction h = {std::sin(theta) * std::cos(phi), std::sin(theta) * std::sin(phi),
                             std::cos(theta)};
        const double weight = at_phi.weight / 2.0 * at_psi.weight * limit * std::sin(2.0 * psi);
        add_reflection(v, h, alpha, weight, &sum);
      }
    }
  }
  return sum;
}

}  // namespace candela::reference
