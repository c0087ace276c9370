// Frames with NaN, Inf and the largest values: the image stays finite, and bad pixels affect no others.
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <string>
#include <vector>

#include "proto/candela/v1/settings.h"
#include "shaders/reference.h"
#include "tests/device/properties_fixture.h"
#include "tests/support/settings.h"
#include "tests/support/status.h"

namespace candela::testing {
namespace {

TEST_F(Properties, OneBadPixelChangesNoOtherPixelsIngest) {
  v1::Settings settings = plain();
  const auto scene = [](float bad) {
    return make_frame(131, 67, v1::PIXEL_FORMAT_RGBA32F, [=](uint32_t x, uint32_t y) -> Texel {
      if (x == 70 && y == 33) return {bad, bad, bad, 1};
      return {noise(x, y, 0), noise(x, y, 1), noise(x, y, 2), 1};
    });
  };
  const std::vector<std::byte> clean = image(must_render(scene(0.5f), settings).memory);
  for (float bad : {NAN, INFINITY, -INFINITY, 1e30f, -1e30f}) {
    std::vector<std::byte> damaged = image(must_render(scene(bad), settings).memory);
    const size_t at = 4 * (33 * 131 + 70);
    std::memcpy(&damaged[at], &clean[at], 4);
    EXPECT_EQ(damaged, clean) << bad;
  }
}

TEST_F(Properties, NaNNeverReachesTheNextFrame) {
  const WireFrame good = natural(131, 67);
  const Rendered before = must_render(good);
  must_render(flat(131, 67, {NAN, NAN, NAN, NAN}));
  const Rendered after = must_render(good);
  EXPECT_EQ(image(before.memory), image(after.memory));
  EXPECT_EQ(before.report.exposure, after.report.exposure);
}

TEST_F(Properties, ABadPixelCountsAsBlackOrBrightest) {
  const auto scene = [](float v) {
    return make_frame(40, 30, v1::PIXEL_FORMAT_RGBA32F, [=](uint32_t x, uint32_t y) -> Texel {
      const float c = x == 3 && y == 29 ? v : 0.5f;
      return {c, c, c, 1};
    });
  };
  EXPECT_EQ(must_render(scene(NAN)).report.exposure, must_render(scene(0)).report.exposure);
  EXPECT_EQ(must_render(scene(-INFINITY)).report.exposure, must_render(scene(-65504)).report.exposure);
  EXPECT_EQ(must_render(scene(INFINITY)).report.exposure, must_render(scene(65504)).report.exposure);
}

TEST_F(Properties, RejectNamesTheFirstBadPixel) {
  v1::Settings settings;
  settings.set_bad_values(v1::BAD_VALUES_REJECT);
  const WireFrame frame = make_frame(200, 150, v1::PIXEL_FORMAT_RGBA16F, [](uint32_t x, uint32_t y) -> Texel {
    const bool bad = (x == 199 && y == 70) || (x == 0 && y == 71) || (x == 64 && y == 149);
    return {1, bad ? INFINITY : 1, bad ? NAN : 1, 1};
  });
  const auto rendered = render(frame, settings);
  ASSERT_EQ(rendered.status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_TRUE(says(rendered.status().message(), "x 199, y 70"));
  EXPECT_TRUE(says(rendered.status().message(), "3 NaN and 3 infinite"));
}

TEST_F(Properties, RejectDoesNotMindBadAlphaOrLargeFiniteValues) {
  v1::Settings settings;
  settings.set_bad_values(v1::BAD_VALUES_REJECT);
  EXPECT_OK(render(flat(9, 9, {1e9f, -1e9f, 1, NAN}, v1::PIXEL_FORMAT_RGBA32F), settings));
}

TEST_F(Properties, NaNInThePaddingOfAReusedTextureIsNotMetered) {
  // Widths of 129 to 132 share their textures, and 132 fills the columns that are padding for 129.
  for (v1::PixelFormat format : {v1::PIXEL_FORMAT_RGBA16F, v1::PIXEL_FORMAT_RGBA32F}) {
    for (float bad : {NAN, INFINITY, -INFINITY, -0.0f}) {
      must_render(flat(132, 67, {bad, bad, bad, bad}, format));
      const FrameReport report = must_render(flat(129, 67, {0.25f, 0.25f, 0.25f, 1}, format)).report;
      EXPECT_NEAR(report.stats.mean_log2_luminance, -2, 2e-5);
      EXPECT_FLOAT_EQ(report.stats.min_luminance, 0.25f);
      EXPECT_FLOAT_EQ(report.stats.max_luminance, 0.25f);
      EXPECT_EQ(report.stats.nan_components + report.stats.infinite_components, 0u);
      EXPECT_FALSE(report.plan.bloom());
      EXPECT_EQ(report.plan.resolve.inputs.constants.scrub, 0u);
    }
  }
}

// A device may drop the sign of a NaN when it converts it.
TEST_F(Properties, ANaNWithItsSignBitSetIsNotCountedAsNegative) {
  const float negative_nan = std::copysign(NAN, -1.0f);
  for (v1::PixelFormat format : {v1::PIXEL_FORMAT_RGBA16F, v1::PIXEL_FORMAT_RGBA32F}) {
    const FrameStats stats = must_render(flat(9, 5, {negative_nan, -1, NAN, 1}, format)).report.stats;
    EXPECT_EQ(stats.nan_components, 2u * 45);
    EXPECT_EQ(stats.negative_components, 45u);
  }
}

TEST_F(Properties, TheLargestExposuresReachTheCurvesLimit) {
  for (v1::ToneCurve curve : kCurves) {
    v1::Settings settings = at_ev(40);
    settings.set_prescale(0x1p40);
    settings.mutable_bloom()->set_intensity(10);
    settings.set_curve(curve);
    settings.set_output_format(v1::OUTPUT_FORMAT_RGBA16);
    const Rendered r = must_render(flat(35, 19, {65504, 65504, 65504, 1}), settings);
    const reference::Rgb limit =
        reference::tone_curve(static_cast<uint32_t>(curve), {0x1p60, 0x1p60, 0x1p60});
    for (size_t k = 0; k < 3; ++k) {
      uint16_t code;
      std::memcpy(&code, &r.memory.output_row(9)[17 * 8 + 2 * k], 2);
      const double expected = reference::transfer(shader::TRANSFER_SRGB, limit[k]);
      EXPECT_NEAR(code / 65535.0, expected, 1e-4) << v1::word_of(curve);
    }
  }
}

TEST_F(Properties, EveryHardCaseIsFiniteUpToTheLargestExposure) {
  for (const HardCase& hard : hard_cases(67, 35)) {
    for (double ev : {-40.0, 0.0, 40.0}) {
      for (v1::ToneCurve curve : kCurves) {
        v1::Settings settings = at_ev(ev);
        settings.set_prescale(ev > 0 ? 0x1p40 : 1.0);
        settings.mutable_bloom()->set_intensity(10);
        settings.set_curve(curve);
        settings.set_output_format(v1::OUTPUT_FORMAT_RGBA16F);
        const Rendered r = must_render(make_frame(67, 35, v1::PIXEL_FORMAT_RGBA32F, hard.texel), settings);
        for (uint32_t y = 0; y < 35; ++y) {
          const auto row = r.memory.output_row(y);
          for (size_t i = 0; i < 67 * 4; ++i) {
            uint16_t bits;
            std::memcpy(&bits, &row[2 * i], 2);
            ASSERT_LT(bits & 0x7fff, 0x7c00) << hard.name << " at 2^" << ev;
            if (i % 4 != 3) {
              ASSERT_LE(bits, 0x3c00) << hard.name << " at 2^" << ev;
            }
          }
        }
      }
    }
  }
}

}  // namespace
}  // namespace candela::testing
