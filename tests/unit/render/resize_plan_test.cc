// The filters of images of another size.
#include "server/render/plan/resize_plan.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <utility>
#include <vector>

namespace candela {
namespace {

const std::vector<std::pair<uint32_t, uint32_t>> kAxes = {
    {1, 1},       {1, 7},      {7, 1},        {2, 3},        {3, 2},     {1920, 1000},   {1080, 563},
    {1000, 1920}, {3840, 480}, {3840, 481},   {16384, 3},    {3, 16384}, {16384, 16383}, {16383, 16384},
    {100, 99},    {99, 100},   {16384, 5000}, {5000, 16384}, {640, 320}, {641, 320}};

double sinc(double t) { return t == 0 ? 1 : std::sin(std::numbers::pi * t) / (std::numbers::pi * t); }

TEST(AxisFilter, IsAMeanForWholeFactorsOnly) {
  for (const auto& [from, to] : kAxes) {
    const AxisFilter filter = axis_filter(from, to);
    EXPECT_EQ(filter.mean, from % to == 0 ? from / to : 0) << from << " to " << to;
    EXPECT_EQ(filter.weights.empty(), from % to == 0);
  }
  EXPECT_EQ(axis_filter(3840, 480).texels(7).first, 56u);
  EXPECT_EQ(axis_filter(3840, 480).texels(7).last, 64u);
}

TEST(AxisFilter, HasTheWeightsOfLanczosInsideOfTheFrame) {
  for (const auto& [from, to] : kAxes) {
    const AxisFilter filter = axis_filter(from, to);
    if (filter.mean > 0) continue;
    SCOPED_TRACE(::testing::Message() << from << " to " << to);
    const double stretch = std::max(1.0, 1.0 * from / to);
    TexelRange before;
    for (uint32_t i = 0; i < to; ++i) {
      const TexelRange range = filter.texels(i), lobe = filter.main_lobe(i);
      ASSERT_LT(range.first, range.last);
      ASSERT_LE(range.last, from);
      ASSERT_LE(range.last - range.first, filter.taps);
      ASSERT_LE(range.first, lobe.first);
      ASSERT_LT(lobe.first, lobe.last);
      ASSERT_LE(lobe.last, range.last);
      ASSERT_GE(range.first, before.first);
      ASSERT_GE(range.last, before.last);
      before = range;
      const auto t = [&](double k) { return (k + 0.5 - (i + 0.5) * from / to) / stretch; };
      double sum = 0;
      for (uint32_t k = range.first; k < range.last; ++k) sum += sinc(t(k)) * sinc(t(k) / 3);
      double total = 0;
      for (uint32_t k = range.first; k < range.last; ++k) {
        const float weight = filter.weights_of(i)[k - range.first];
        ASSERT_NEAR(weight, sinc(t(k)) * sinc(t(k) / 3) / sum, 1e-7) << "texel " << k << " of " << i;
        ASSERT_EQ(k >= lobe.first && k < lobe.last, std::abs(t(k)) < 1 - 1e-12);
        total += weight;
      }
      ASSERT_NEAR(total, 1, 1e-6);
      // All texels that the filter reaches, and no others.
      ASSERT_TRUE(range.first == 0 || t(range.first - 1.0) <= -3 + 1e-9);
      ASSERT_TRUE(range.last == from || t(range.last) >= 3 - 1e-9);
      if (i > 100 && i + 100 < to && to > 1000) i += 37;
    }
  }
}

TEST(AxisFilter, KeepsTexelsThatKeepTheirPlace) {
  // The middle of 3 is the middle of 5.
  const AxisFilter filter = axis_filter(3, 5);
  const float* const weights = filter.weights_of(2);
  EXPECT_FLOAT_EQ(weights[1], 1);
  EXPECT_EQ(weights[0], 0);
  EXPECT_EQ(weights[2], 0);
}

}  // namespace
}  // namespace candela
