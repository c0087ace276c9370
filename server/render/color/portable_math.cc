#include "server/render/color/portable_math.h"

#include <cmath>
#include <limits>

namespace candela {

namespace {

// The sum of two doubles of which the second is at most half a unit of the first's last place: 106 bits. Only
// IEEE's own operations, so nothing depends on the machine.
struct Long {
  double high = 0;
  double low = 0;
};

// |a| >= |b|, or a is 0.
Long fast_sum(double a, double b) {
  const double sum = a + b;
  return {sum, b - (sum - a)};
}

Long two_sum(double a, double b) {
  const double high = a + b;
  const double part = high - a;
  return {high, (a - (high - part)) + (b - part)};
}

Long operator+(const Long& a, const Long& b) {
  const Long high = two_sum(a.high, b.high);
  return fast_sum(high.high, high.low + (a.low + b.low));
}

Long operator*(const Long& a, const Long& b) {
  const double high = a.high * b.high;
  return fast_sum(high, std::fma(a.high, b.high, -high) + (a.high * b.low + a.low * b.high));
}

Long operator/(const Long& a, const Long& b) {
  const double first = a.high / b.high;
  const Long back = Long{first} * b;
  const Long rest = a + Long{-back.high, -back.low};
  return fast_sum(first, rest.high / b.high);
}

constexpr Long kLn2 = {0x1.62e42fefa39efp-1, 0x1.abc9e3b39803fp-56};
constexpr int kTerms = 26;  // 0.35^26 / 26! < 2^-120

// (e^x - 1) / x for |x| < 0.6.
Long exp_slope(const Long& x) {
  Long slope = {1};
  for (int n = kTerms; n >= 2; --n) slope = Long{1} + x * slope / Long{static_cast<double>(n)};
  return slope;
}

Long exp_near_0(const Long& x) { return Long{1} + x * exp_slope(x); }

constexpr double kMostExponent = 2000;  // whatever is beyond overflows, or is 0

// x = whole * ln 2 + the result.
Long without_powers(double x, double whole) {
  const Long powers = Long{-whole} * kLn2;
  return Long{x} + powers;
}

}  // namespace

double portable_exp2(double x) {
  if (!(std::fabs(x) < kMostExponent)) return x < 0 ? 0 : x > 0 ? std::numeric_limits<double>::infinity() : x;
  const double whole = std::nearbyint(x);
  return std::ldexp(exp_near_0(Long{x - whole} * kLn2).high, static_cast<int>(whole));
}

double portable_exp(double x) {
  const double whole = std::nearbyint(x / kLn2.high);
  if (!(std::fabs(whole) < kMostExponent))
    return x < 0 ? 0 : x > 0 ? std::numeric_limits<double>::infinity() : x;
  return std::ldexp(exp_near_0(without_powers(x, whole)).high, static_cast<int>(whole));
}

double portable_expm1(double x) {
  if (std::fabs(x) < 0.5) return (Long{x} * exp_slope(Long{x})).high;
  const double whole = std::nearbyint(x / kLn2.high);
  if (!(std::fabs(whole) < kMostExponent))
    return x < 0 ? -1 : x > 0 ? std::numeric_limits<double>::infinity() : x;
  const Long power = exp_near_0(without_powers(x, whole));
  const auto exponent = static_cast<int>(whole);
  if (exponent > 200) return std::ldexp(power.high, exponent);
  return (Long{std::ldexp(power.high, exponent), std::ldexp(power.low, exponent)} + Long{-1}).high;
}

double portable_log2(double x) {
  if (!(x > 0) || std::isinf(x)) return x > 0 ? x : std::numeric_limits<double>::quiet_NaN();
  int exponent = 0;
  double mantissa = std::frexp(x, &exponent);
  if (mantissa < 0x1.6a09e667f3bcdp-1) {  // sqrt 1/2
    mantissa *= 2;
    --exponent;
  }
  // ln m = 2 artanh((m - 1) / (m + 1)), of at most 0.172.
  const Long part = Long{mantissa - 1} / (Long{mantissa} + Long{1});
  const Long square = part * part;
  Long series;
  for (int n = 2 * kTerms - 1; n >= 1; n -= 2) {
    series = Long{1} / Long{static_cast<double>(n)} + square * series;
  }
  const Long log = Long{2} * part * series / kLn2;
  return (Long{static_cast<double>(exponent)} + log).high;
}

double portable_power(double x, double y) { return x > 0 ? portable_exp2(y * portable_log2(x)) : 0.0; }

}  // namespace candela
