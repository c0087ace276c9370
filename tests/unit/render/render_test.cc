// The host's decisions: sizes, limits, settings, primaries, exposure, plan. No device.
#include <gtest/gtest.h>

#include <cmath>

#include "server/render/color/primaries.h"
#include "server/render/plan/exposure.h"
#include "server/render/plan/plan.h"
#include "server/render/settings/settings.h"
#include "shaders/reference.h"
#include "tests/support/settings.h"
#include "tests/support/status.h"

namespace candela {
namespace {

TEST(Frame, IsRefusedBeyondTheLimitsWithoutOverflow) {
  const FrameLimits limits = {16384, uint64_t{1} << 29};
  EXPECT_OK(check_frame({7680, 4320, v1::PIXEL_FORMAT_RGBA16F}, limits));
  EXPECT_EQ(check_frame({0, 5, v1::PIXEL_FORMAT_RGBA16F}, limits).code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(check_frame({16385, 1, v1::PIXEL_FORMAT_RGBA16F}, limits).code(),
            absl::StatusCode::kResourceExhausted);
  EXPECT_EQ(check_frame({16384, 16384, v1::PIXEL_FORMAT_RGBA32F}, limits).code(),
            absl::StatusCode::kResourceExhausted);
  EXPECT_EQ(
      check_frame({UINT32_MAX, UINT32_MAX, v1::PIXEL_FORMAT_RGBA32F}, {UINT32_MAX, uint64_t{1} << 40}).code(),
      absl::StatusCode::kResourceExhausted);
}

TEST(Bloom, LevelsEndBeforeTheShortSideIsUnderTwo) {
  const auto count = [](uint32_t w, uint32_t h, uint32_t n) { return bloom_level_sizes(w, h, n, 2).size(); };
  EXPECT_EQ(count(1, 1, 5), 1u);
  EXPECT_EQ(count(16384, 1, 5), 1u);
  EXPECT_EQ(count(4, 4, 5), 1u);  // 2x2, and 1x1 would follow
  EXPECT_EQ(count(5, 5, 5), 2u);  // 3x3, 2x2
  EXPECT_EQ(count(1920, 1080, 5), 5u);
  EXPECT_EQ(count(1920, 1080, 16), 10u);
  const LevelSize odd = bloom_level_sizes(333, 517, 2, 2)[1];
  EXPECT_EQ(odd.width, 84u);
  EXPECT_EQ(odd.height, 130u);
}

TEST(Settings, NameTheFieldItsValueAndItsRange) {
  const auto message = [](auto change) {
    v1::Settings settings;
    change(settings);
    return std::string(Settings::from(settings).status().message());
  };
  EXPECT_OK(Settings::from({}));
  EXPECT_EQ(message([](v1::Settings& s) { s.mutable_bloom()->set_intensity(11); }),
            "bloom.intensity is 11; it must be between 0 and 10");
  EXPECT_EQ(message([](v1::Settings& s) { s.mutable_bloom()->set_levels(0); }),
            "bloom.levels is 0; it must be between 1 and 16");
  EXPECT_NE(message([](v1::Settings& s) { s.mutable_exposure()->set_key(NAN); }), "");
  EXPECT_NE(message([](v1::Settings& s) { s.set_prescale(INFINITY); }), "");
  EXPECT_NE(message([](v1::Settings& s) { s.mutable_exposure()->set_min_exposure(0); }), "");
  EXPECT_NE(message([](v1::Settings& s) { s.mutable_exposure()->set_min_exposure(65); }), "");
  EXPECT_TRUE(says(message([](v1::Settings& s) { s.set_tier("best"); }), "standard"));
  EXPECT_NE(message([](v1::Settings& s) { s.mutable_input_chromaticities(); }), "");
}

TEST(Primaries, MatchThePublishedMatrices) {
  // ITU-R BT.2087-0: Rec.2020 to Rec.709.
  const auto rec2020 = matrix_to_rec709({{0.708, 0.292, 0.170, 0.797, 0.131, 0.046, 0.3127, 0.3290}});
  ASSERT_TRUE(rec2020.ok() && rec2020->has_value());
  const double expected2020[9] = {1.6605,  -0.5876, -0.0728, -0.1246, 1.1329,
                                  -0.0083, -0.0182, -0.1006, 1.1187};
  for (size_t i = 0; i < 9; ++i) EXPECT_NEAR((**rec2020)[i], expected2020[i], 1e-4) << i;
  // IEC 61966-2-1: XYZ to linear sRGB, four digits.
  const auto xyz = matrix_to_rec709({{1, 0, 0, 1, 0, 0, 1.0 / 3, 1.0 / 3}});
  ASSERT_TRUE(xyz.ok() && xyz->has_value());
  const double expected_xyz[9] = {3.2406, -1.5372, -0.4986, -0.9689, 1.8758, 0.0415, 0.0557, -0.2040, 1.0570};
  for (size_t i = 0; i < 9; ++i) EXPECT_NEAR((**xyz)[i], expected_xyz[i], 5e-4) << i;
  // White stays white after adaptation: ACES AP0.
  const auto ap0 = matrix_to_rec709({{0.7347, 0.2653, 0, 1, 0.0001, -0.0770, 0.32168, 0.33767}});
  ASSERT_TRUE(ap0.ok() && ap0->has_value());
  for (size_t r = 0; r < 3; ++r) {
    EXPECT_NEAR((**ap0)[3 * r] + (**ap0)[3 * r + 1] + (**ap0)[3 * r + 2], 1.0, 1e-5);
  }
}

TEST(Primaries, OfRec709NeedNoMatrixAndSingularOnesAreRefused) {
  ASSERT_OK_AND_ASSIGN(const auto rec709,
                       matrix_to_rec709({{0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290}}));
  EXPECT_FALSE(rec709.has_value());
  EXPECT_FALSE(matrix_to_rec709({{0.3, 0.3, 0.3, 0.3, 0.3, 0.3, 0.3, 0.3}}).ok());
  EXPECT_FALSE(matrix_to_rec709({{0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0}}).ok());
  // The primaries are independent, but the matrix would exceed a float's range.
  EXPECT_FALSE(matrix_to_rec709({{-0.7238643181910811, -5.97e-216, -4.97e+272, -3.74e-159,
                                  -0.081465836816720816, -1.41e-139, 6.4829e-06, 0.69833}})
                   .ok());
  EXPECT_FALSE(matrix_to_rec709({{NAN, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290}}).ok());
}

TEST(Exposure, FollowsTheKeyWithinItsLimits) {
  v1::Exposure settings = Settings()->exposure();
  EXPECT_DOUBLE_EQ(exposure_target(settings, std::log2(0.18)), 1.0);
  settings.set_compensation_ev(1);
  EXPECT_DOUBLE_EQ(exposure_target(settings, std::log2(0.18)), 2.0);
  EXPECT_DOUBLE_EQ(exposure_target(settings, -100), 64.0);
  EXPECT_DOUBLE_EQ(exposure_target(settings, 100), 1.0 / 64);
  settings.set_mode(v1::Exposure::MODE_MANUAL);
  settings.set_manual_ev(10);
  EXPECT_DOUBLE_EQ(exposure_target(settings, 3), 1024.0);
}

TEST(Plan, HoldsOnlyWhatTheFrameNeeds) {
  const FrameDesc desc = {1920, 1080, v1::PIXEL_FORMAT_RGBA16F};
  FrameStats stats;
  stats.max_luminance = 0.5f;
  stats.tile_light.assign(30 * 17, 0.25f);
  const auto plan_of = [&](const v1::Settings& settings, bool scrubbed = false) {
    const Settings complete = testing::checked(settings);
    return plan_frame(layout_textures(desc, complete), {stats, scrubbed}, complete, {});
  };
  EXPECT_FALSE(plan_of({}).bloom());
  EXPECT_EQ(plan_of({}).words[1], "no bloom: nothing passes the threshold 1 (the brightest is 0.5)");

  stats.tile_light[31] = 3.0f;
  v1::Settings settings;
  settings.mutable_bloom()->set_levels(3);
  const std::vector<std::pair<Pass, uint32_t>> bright = {{Pass::kBrightPass, 0},
                                                         {Pass::kBloomDown, 1},
                                                         {Pass::kBloomDown, 2},
                                                         {Pass::kBloomUp, 1},
                                                         {Pass::kBloomUp, 0}};
  const Plan plan = plan_of(settings);
  std::vector<std::pair<Pass, uint32_t>> steps;
  for (const BloomStep& step : plan.bloom_steps) steps.emplace_back(step.pass, step.level);
  EXPECT_EQ(steps, bright);
  EXPECT_EQ(plan.lit, (std::vector<Box>{{64, 64, 128, 128}}));
  EXPECT_EQ(plan.words[1],
            "bloom over 3 levels from 960x540 to 240x135: light in 0.2 % of the frame's tiles");
  settings.mutable_bloom()->set_intensity(0);
  EXPECT_FALSE(plan_of(settings).bloom());
  EXPECT_EQ(plan_of(settings, false).resolve.inputs.constants.scrub, 0u);
  EXPECT_EQ(plan_of(settings, true).resolve.inputs.constants.scrub, 1u);
}

// The table of docs/pipeline.md section 5, published by the curves' authors or computed from their
// definitions.
TEST(ToneCurve, HasItsPublishedValueAtOne) {
  const auto at_one = [](uint32_t curve) { return reference::tone_curve(curve, {1, 1, 1})[1]; };
  EXPECT_DOUBLE_EQ(at_one(shader::CURVE_LINEAR), 1.0);
  EXPECT_DOUBLE_EQ(at_one(shader::CURVE_REINHARD), 0.5);
  EXPECT_NEAR(at_one(shader::CURVE_ACES_NARKOWICZ), 0.803797, 1e-6);
  EXPECT_NEAR(at_one(shader::CURVE_ACES_HILL), 0.619115, 1e-5);
  EXPECT_DOUBLE_EQ(at_one(shader::CURVE_REINHARD_EXTENDED), 0.53125);
  EXPECT_NEAR(at_one(shader::CURVE_HABLE), 0.492919, 1e-6);
  EXPECT_NEAR(at_one(shader::CURVE_PBR_NEUTRAL), 0.869091, 1e-6);
  const reference::Rgb agx = reference::tone_curve(shader::CURVE_AGX, {1, 1, 1});
  EXPECT_NEAR(agx[0], 0.591281, 1e-6);
  EXPECT_NEAR(agx[1], 0.591239, 1e-6);
  EXPECT_NEAR(agx[2], 0.591237, 1e-6);
}

TEST(Transfer, OfTheReferenceIsTheStandards) {
  EXPECT_DOUBLE_EQ(reference::transfer(shader::TRANSFER_SRGB, 1.0), 1.0);
  EXPECT_NEAR(reference::transfer(shader::TRANSFER_SRGB, 0.0031308), 0.040450, 1e-6);
  EXPECT_NEAR(reference::transfer(shader::TRANSFER_SRGB, 0.214041), 0.5, 1e-6);
  EXPECT_DOUBLE_EQ(reference::transfer(shader::TRANSFER_GAMMA22, 0.25), std::pow(0.25, 1 / 2.2));
}

}  // namespace
}  // namespace candela
