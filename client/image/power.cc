#include "client/image/power.h"

#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>

namespace candela {
namespace {

// The sum of c[i] x^i: the even and the odd powers apart, which a processor adds side by side.
template <size_t kCount>
double polynomial(const std::array<double, kCount>& c, double x) {
  static_assert(kCount % 2 == 0);
  const double square = x * x;
  double even = 0, odd = 0;
  for (size_t i = kCount; i > 0; i -= 2) {
    odd = odd * square + c[i - 1];
    even = even * square + c[i - 2];
  }
  return even + odd * x;
}

// ln(2)^i / i!, of Taylor's series of 2^x.
constexpr std::array<double, 14> kExp2Terms = [] {
  constexpr double kLn2 = 0.6931471805599453;
  std::array<double, 14> terms{1};
  for (size_t i = 1; i < terms.size(); ++i) terms[i] = terms[i - 1] * kLn2 / static_cast<double>(i);
  return terms;
}();

// 2 / ln 2 / (2 i + 1), of log2 m = sum of them times t^(2 i + 1), t = (m - 1) / (m + 1).
constexpr std::array<double, 12> kLog2Terms = [] {
  std::array<double, 12> terms{};
  for (size_t i = 0; i < terms.size(); ++i) terms[i] = 2.8853900817779268 / static_cast<double>(2 * i + 1);
  return terms;
}();

// 2^x, of the nearest integer and the rest, -0.5 .. 0.5.
double exp2_of(double x) {
  constexpr double kMost = 1100;
  if (!(x > -kMost)) return std::isnan(x) ? x : 0.0;
  if (x > kMost) return std::numeric_limits<double>::infinity();
  const int whole = static_cast<int>(x < 0 ? x - 0.5 : x + 0.5);
  const double rest = polynomial(kExp2Terms, x - whole);
  constexpr int kBias = 1023;
  if (whole <= -kBias || whole > kBias) return std::ldexp(rest, whole);
  return rest * std::bit_cast<double>(static_cast<uint64_t>(whole + kBias) << 52);
}

}  // namespace

double log2_of(double x) {
  constexpr uint64_t kFraction = (uint64_t{1} << 52) - 1, kOne = uint64_t{1023} << 52;
  const bool tiny = x < std::numeric_limits<double>::min();
  const auto bits = std::bit_cast<uint64_t>(tiny ? x * 0x1p54 : x);
  int exponent = static_cast<int>(bits >> 52) - 1023 - (tiny ? 54 : 0);
  double m = std::bit_cast<double>((bits & kFraction) | kOne);
  if (m > 1.4142135623730951) {
    m /= 2;
    ++exponent;
  }
  const double t = (m - 1) / (m + 1);
  return exponent + t * polynomial(kLog2Terms, t * t);
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
