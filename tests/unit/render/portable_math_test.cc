// The functions of server/render/color/portable_math.h against those of long double, and a few of their bits.
#include "server/render/color/portable_math.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

namespace candela {
namespace {

// Half a unit in the last place, and what long double itself may be wrong by.
void expect_rounded(double ours, long double exact, double x) {
  const double unit = std::nextafter(std::fabs(ours), INFINITY) - std::fabs(ours);
  EXPECT_LE(std::fabs(static_cast<double>(ours - exact)), 0.501 * unit) << x;
}

TEST(PortableMath, IsRoundedToTheNearest) {
  std::mt19937_64 random(1);
  const auto between = [&](double low, double high) {
    return low + (high - low) * std::ldexp(static_cast<double>(random() >> 11), -53);
  };
  for (int i = 0; i < 20000; ++i) {
    double x = between(-80, 80);
    expect_rounded(portable_exp2(x), std::exp2(static_cast<long double>(x)), x);
    expect_rounded(portable_exp(x), std::exp(static_cast<long double>(x)), x);
    x = between(-30, 30) * (i % 2 == 0 ? 1 : 0.01);
    expect_rounded(portable_expm1(x), std::expm1(static_cast<long double>(x)), x);
    x = std::exp(between(-60, 60));
    expect_rounded(portable_log2(x), std::log2(static_cast<long double>(x)), x);
  }
}

TEST(PortableMath, HasTheSameBitsEverywhere) {
  EXPECT_EQ(portable_exp2(0.3), 0x1.3b2c47bff8329p+0);
  EXPECT_EQ(portable_exp(-0.7), 0x1.fc80db9dd5542p-2);
  EXPECT_EQ(portable_expm1(-0.1), -0x1.85c933156a62cp-4);
  EXPECT_EQ(portable_log2(0.18), -0x1.3ca9c6f53897ap+1);
}

TEST(PortableMath, PowersOfTwoAreExactAndTheEndsAreThere) {
  for (int i = -1000; i <= 1000; ++i) {
    EXPECT_EQ(portable_exp2(i), std::ldexp(1.0, i));
    EXPECT_EQ(portable_log2(std::ldexp(1.0, i)), i);
  }
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  EXPECT_EQ(portable_exp(0), 1);
  EXPECT_EQ(portable_expm1(0), 0);
  EXPECT_EQ(portable_exp(-1e12), 0);
  EXPECT_EQ(portable_expm1(-1e12), -1);
  EXPECT_EQ(portable_exp2(-kInfinity), 0);
  for (double (*grows)(double) : {portable_exp2, portable_exp, portable_expm1, portable_log2}) {
    EXPECT_EQ(grows(kInfinity), kInfinity);
    EXPECT_TRUE(std::isnan(grows(NAN)));
  }
}

}  // namespace
}  // namespace candela
