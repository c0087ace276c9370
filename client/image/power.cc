#include "client/image/power.h"

#include <cmath>
#include <limits>

namespace candela {
namespace {

// 2^x: Taylor's series of e^(r ln 2) for the rest r, -0.5 .. 0.5, of the nearest integer.
double exp2_of(double x) {
  constexpr double kMost = 1100, kLn2 = 0.6931471805599453;
  if (!(x > -kMost)) return std::isnan(x) ? x : 0.0;
  if (x > kMost) return std::numeric_limits<double>::infinity();
  const int whole = static_cast<int>(x < 0 ? x - 0.5 : x + 0.5);
  const double r = (x - whole) * kLn2;
  double sum = 1;
  for (int i = 13; i > 0; --i) sum = 1 + sum * r * (1.0 / i);
  return std::ldexp(sum, whole);
}

}  // namespace

// ln m = 2 (t + t^3 / 3 + t^5 / 5 ...), t = (m - 1) / (m + 1), for m within sqrt(1/2) .. sqrt(2).
double log2_of(double x) {
  constexpr double kTwoOverLn2 = 2.8853900817779268, kSqrtHalf = 0.7071067811865476;
  int exponent = 0;
  double m = std::frexp(x, &exponent);
  if (m < kSqrtHalf) {
    m *= 2;
    --exponent;
  }
  const double t = (m - 1) / (m + 1), square = t * t;
  double sum = 0;
  for (int i = 21; i > 0; i -= 2) sum = sum * square + 1.0 / i;
  return exponent + kTwoOverLn2 * (t * sum);
}

double exponential(double x) {
  constexpr double kLog2E = 1.4426950408889634;
  return exp2_of(x * kLog2E);
}

double power(double x, double y) {
  if (!(x > 0) || std::isinf(x)) return x;
  return exp2_of(y * log2_of(x));
}

}  // namespace candela
