// Gain maps beside SDR images, as the executors make them.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <string>
#include <vector>

#include "proto/candela/v1/settings.h"
#include "tests/support/device_fixture.h"
#include "tests/support/settings.h"
#include "tests/support/status.h"

namespace candela::testing {
namespace {

v1::Settings with_map(v1::ToneCurve curve, double peak_nits = 1000) {
  v1::Settings settings = plain();
  settings.set_curve(curve);
  settings.set_gain_map_peak_nits(peak_nits);
  settings.set_output_format(v1::OUTPUT_FORMAT_RGBA8);
  return settings;
}

const GainCurve& curve_of(const v1::Settings& settings) {
  static std::vector<std::shared_ptr<const GainCurve>> kept;
  return *kept.emplace_back(Settings::from(settings).value().gain_curve());
}

class GainMap : public DeviceTest {};

TEST(GainCurve, HasThePublishedShoulders) {
  struct Case {
    v1::ToneCurve curve;
    double steepest, shoulder;
  };
  for (const Case& one :
       {Case{v1::TONE_CURVE_ACES_HILL, .750526, .4574}, Case{v1::TONE_CURVE_ACES_NARKOWICZ, 1.502841, .2222},
        Case{v1::TONE_CURVE_AGX, 1.316959, .0892}, Case{v1::TONE_CURVE_LINEAR, 1, 1}}) {
    const GainCurve& curve = curve_of(with_map(one.curve));
    EXPECT_NEAR(curve.steepest(), one.steepest, 1e-4) << v1::word_of(one.curve);
    if (one.curve != v1::TONE_CURVE_LINEAR) {
      EXPECT_NEAR(curve.shoulder(), one.shoulder, 0.012 * one.shoulder);
    }
  }
}

double pq_of(double nits) {
  const double y = std::pow(nits / 10000, 2610 / 16384.0);
  return std::pow((107 / 128.0 + 2413 / 128.0 * y) / (1 + 2392 / 128.0 * y), 2523 / 32.0);
}

double nits_of(double pq) {
  const double p = std::pow(pq, 32 / 2523.0);
  return 10000 * std::pow(std::max(p - 107 / 128.0, 0.0) / (2413 / 128.0 - 2392 / 128.0 * p), 16384 / 2610.0);
}

// The page's formula again, for aces-hill at 1000 nit. Greys stay grey but for the last digits of its
// matrices.
TEST(GainCurve, IsTheFormulaOfThePage) {
  const GainCurve& curve = curve_of(with_map(v1::TONE_CURVE_ACES_HILL));
  const double most = pq_of(1000), knee = 1.5 * most - 0.5;
  for (const double n : {0.3, 0.5, 0.7, 1.0, 2.0, 5.0, 9.0, 20.0, 60.0, 500.0}) {
    const double sdr = (n * (n + 0.0245786) - 0.000090537) / (n * (0.983729 * n + 0.4329510) + 0.238081);
    double hdr = .750526 * n * 203;
    if (const double e = std::min(pq_of(std::min(hdr, 1e4)), 1.0); e >= knee) {
      const double t = (e - knee) / (1 - knee);
      hdr = nits_of((1 + 2 * t) * (1 - t) * (1 - t) * knee + t * (1 - t) * (1 - t) * (1 - knee) +
                    t * t * (3 - 2 * t) * most);
    }
    const double gain = n > .4574 ? std::max(0.0, std::log2(hdr / 203 / std::min(sdr, 1.0))) : 0;
    EXPECT_NEAR(curve.log2_gain(n), gain, 2e-3) << n;
  }
}

// A film's black is above 0, and so is that of many looks: the dark keeps its SDR light all the same.
TEST(GainCurve, ALiftedBlackOpensNoShadows) {
  std::vector<float> rgb = lattice_light(33, shader::AXES_REC709, 32);
  for (float& v : rgb) v = 0.01f + 0.95f * std::max(v, 0.0f) / (std::max(v, 0.0f) + 0.6f);
  v1::Settings settings = with_map(v1::TONE_CURVE_TABLE);
  *settings.mutable_table() = to_message(make_color_table(33, shader::AXES_REC709, 32, rgb));
  const GainCurve& curve = curve_of(settings);
  EXPECT_LE(curve.log2_gain(0.01), 0.1);
  EXPECT_LE(curve.log2_gain(0.18), 0.5);
  EXPECT_GT(curve.log2_gain(20), 1.5);
  EXPECT_LE(curve.max_log2(), std::log2(1000 / 203.0) + 0.3);
}

// It begins at 0, never falls on the way up to where the curve is flat, and ends at the display's peak.
TEST(GainCurve, EndsAtTheDisplaysPeak) {
  for (const double peak : {203.0, 400.0, 1000.0, 10000.0}) {
    const GainCurve& curve = curve_of(with_map(v1::TONE_CURVE_ACES_HILL, peak));
    EXPECT_EQ(curve.log2_gain(0), 0);
    EXPECT_EQ(curve.log2_gain(0.9 * curve.shoulder()), 0);
    EXPECT_NEAR(curve.max_log2(), std::max(std::log2(peak / 203), 1.0 / 64), 0.02) << peak;
    EXPECT_NEAR(curve.log2_gain(1e30), std::log2(peak / 203), 0.02) << peak;
    double before = 0;
    for (double n = 0.01; n < 30; n *= 1.01) {
      EXPECT_GE(curve.log2_gain(n), before - 1e-3) << n;
      before = curve.log2_gain(n);
    }
  }
}

TEST_F(GainMap, IsWithinHalfACodeAndTheImageIsThatWithoutIt) {
  const WireFrame frame = make_frame(131, 67, v1::PIXEL_FORMAT_RGBA32F, [](uint32_t x, uint32_t y) -> Texel {
    const float light = std::exp2(static_cast<float>(x) / 8.0f - 8.0f);
    return {light, light * static_cast<float>(y) / 66.0f, light / 3.0f, y % 2 == 0 ? 1.0f : 0.5f};
  });
  for (const v1::ToneCurve curve : {v1::TONE_CURVE_ACES_HILL, v1::TONE_CURVE_LINEAR, v1::TONE_CURVE_REINHARD,
                                    v1::TONE_CURVE_AGX, v1::TONE_CURVE_ACES_1, v1::TONE_CURVE_ACES_2}) {
    v1::Settings settings = with_map(curve);
    const GainCurve& truth = curve_of(settings);
    v1::Settings without = settings;
    without.clear_gain_map_peak_nits();
    for (const ExecutorKind kind : {ExecutorKind::kHost, ExecutorKind::kDevice}) {
      for (const char* tier : {"standard", "reference"}) {
        settings.set_tier(tier);
        without.set_tier(tier);
        const auto rendered = render_on(renderer_with(kind), frame, settings);
        const auto plain_image = render_on(renderer_with(kind), frame, without);
        ASSERT_OK(rendered);
        ASSERT_OK(plain_image);
        ASSERT_NE(rendered->report.plan.gain, nullptr);
        const auto made = image(rendered->memory), other = image(plain_image->memory);
        double worst = 0;
        for (size_t i = 0; i < made.size(); ++i) {
          if (i % 4 < 3) {
            ASSERT_EQ(made[i], other[i]) << v1::word_of(curve) << " " << i;
            continue;
          }
          const auto x = static_cast<uint32_t>(i / 4 % 131), y = static_cast<uint32_t>(i / 4 / 131);
          const double light = std::exp2(x / 8.0 - 8.0);
          const double largest = std::max({light, light * y / 66.0, light / 3});
          worst = std::max(worst, std::abs(std::to_integer<int>(made[i]) -
                                           255 * std::min(1.0, truth.log2_gain(largest) / truth.max_log2())));
        }
        EXPECT_LE(worst, 0.55) << v1::word_of(curve) << " " << executor_word(kind) << " " << tier;
      }
    }
  }
}

TEST_F(GainMap, WhatHasNoGainMapIsRefused) {
  const auto refusal = [](v1::Settings settings) {
    return std::string(Settings::from(settings).status().message());
  };
  v1::Settings settings = with_map(v1::TONE_CURVE_ACES_HILL);
  settings.set_output_format(v1::OUTPUT_FORMAT_RGBA16);
  EXPECT_TRUE(says(refusal(settings), "output_format is rgba16"));
  settings = with_map(v1::TONE_CURVE_ACES_HILL);
  settings.set_alpha(v1::ALPHA_STRAIGHT);
  EXPECT_TRUE(says(refusal(settings), "alpha is straight"));
  settings = with_map(v1::TONE_CURVE_ACES_HILL);
  settings.set_transfer(v1::TRANSFER_GAMMA22);
  EXPECT_TRUE(says(refusal(settings), "transfer is gamma22"));
  settings = with_map(v1::TONE_CURVE_ACES_HILL, 100);
  EXPECT_TRUE(says(refusal(settings), "gain_map_peak_nits is 100"));
}

}  // namespace
}  // namespace candela::testing
