// metering.ignore_below: dark texels are not metered, and a frame that has no others keeps its exposure.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "server/render/plan/exposure.h"
#include "shaders/reference.h"
#include "tests/support/device_fixture.h"
#include "tests/support/settings.h"
#include "tests/support/status.h"

namespace candela::testing {
namespace {

reference::MeterParams params_of(const v1::Settings& settings) {
  const v1::Metering& metering = settings.exposure().metering();
  return {.percentile = metering.statistic() == v1::Metering::STATISTIC_PERCENTILE,
          .weights = static_cast<uint32_t>(metering.weights()),
          .spot = {metering.spot().x0(), metering.spot().y0(), metering.spot().x1(), metering.spot().y1()},
          .ignore_below = metering.ignore_below()};
}

reference::Scene scene_of(const WireFrame& frame) {
  reference::BadCounts bad;
  return reference::ingest(frame.pixels, frame.desc.row_bytes(), frame.desc.width, frame.desc.height,
                           static_cast<uint32_t>(frame.desc.format), std::nullopt, reference::Rounding::kHalf,
                           &bad);
}

// The plain definition, without the reference's meter(). No alpha is 0.
uint64_t weight_of(const reference::Scene& scene, const reference::MeterParams& params) {
  const auto code = [](const auto& c) { return std::lround(255.0 * c[3]); };
  const bool parts =
      std::any_of(scene.texels.begin(), scene.texels.end(), [&](const auto& c) { return code(c) < 255; });
  const double unit = parts && params.weights != shader::WEIGHTS_CENTER ? 255.0 : 1.0;
  uint64_t weight = 0;
  for (uint32_t y = 0; y < scene.height; ++y) {
    for (uint32_t x = 0; x < scene.width; ++x) {
      const auto& c = scene.at(x, y);
      const float l = (0.2126f * c[0] + 0.7152f * c[1]) + 0.0722f * c[2];
      if (l < params.ignore_below) continue;
      const uint32_t whole = reference::meter_weight(x, y, scene.width, scene.height, params);
      weight += std::lround(unit * whole * static_cast<double>(code(c)) / 255.0);
    }
  }
  return weight;
}

class IgnoreBelow : public DeviceTest {
 protected:
  static FrameReport report(const WireFrame& frame, const v1::Settings& settings,
                            const FrameMoment& moment = {}, Verify verify = Verify::kNo) {
    auto rendered = render(frame, settings, moment, verify);
    if (!rendered.ok()) throw std::runtime_error(rendered.status().ToString());
    return rendered->report;
  }

  static void expect_as_reference(const WireFrame& frame, const v1::Settings& settings) {
    const reference::MeterParams params = params_of(settings);
    const reference::Scene scene = scene_of(frame);
    const reference::Meter truth = reference::meter(scene, params);
    const FrameStats stats = report(frame, settings).stats;
    SCOPED_TRACE(::testing::Message() << frame.desc.width << "x" << frame.desc.height << " "
                                      << settings.exposure().metering().ShortDebugString());
    EXPECT_EQ(stats.metered_weight, weight_of(scene, params));
    EXPECT_EQ(truth.weight, weight_of(scene, params));
    EXPECT_NEAR(stats.mean_log2_luminance, truth.mean_log2_luminance, 2e-5);
    EXPECT_FLOAT_EQ(stats.min_luminance, static_cast<float>(truth.min_luminance));
    EXPECT_FLOAT_EQ(stats.max_luminance, static_cast<float>(truth.max_luminance));
  }
};

TEST_F(IgnoreBelow, MetersWhatTheReferenceMeters) {
  for (const auto& [width, height] :
       {std::pair{1u, 1u}, {3u, 5u}, {63u, 65u}, {64u, 64u}, {65u, 63u}, {131u, 67u}, {641u, 359u}}) {
    const WireFrame frame = natural(width, height);
    for (const auto statistic : kStatistics) {
      for (const auto weights : kWeights) {
        for (const float limit : {1e-4f, 0.05f, 0.2f, 1.0f, 8.0f}) {
          expect_as_reference(frame, metering_settings(statistic, weights, limit));
        }
      }
    }
  }
}

// Luminances within a few roundings of the limit: both twins have to decide alike.
TEST_F(IgnoreBelow, DecidesInFloat32) {
  for (const auto format : {v1::PIXEL_FORMAT_RGBA16F, v1::PIXEL_FORMAT_RGBA32F, v1::PIXEL_FORMAT_RGB9E5}) {
    const WireFrame frame = make_frame(131, 67, format, [](uint32_t x, uint32_t y) -> Texel {
      const auto near = [&](uint32_t k) { return 0.25f + 0x1p-12f * std::floor(16 * noise(x, y, k)); };
      return {near(0), near(1), near(2), 1};
    });
    const reference::Scene scene = scene_of(frame);
    for (uint32_t x = 0; x < 131; x += 9) {
      const auto& c = scene.at(x, x / 2);
      const float limit = (0.2126f * c[0] + 0.7152f * c[1]) + 0.0722f * c[2];
      for (const float l : {limit, std::nextafter(limit, 1.0f), std::nextafter(limit, 0.0f)}) {
        expect_as_reference(frame, metering_settings(kStatistics[0], kWeights[0], l));
        expect_as_reference(frame, metering_settings(kStatistics[1], kWeights[1], l));
      }
    }
  }
}

TEST_F(IgnoreBelow, ATexelAtTheLimitIsMetered) {
  const WireFrame frame = flat(67, 3, {0.5f, 0.25f, 2.0f, 1.0f});
  const float l = (0.2126f * 0.5f + 0.7152f * 0.25f) + 0.0722f * 2.0f;
  const auto weight = [&](float limit) {
    return report(frame, metering_settings(kStatistics[0], kWeights[0], limit)).stats.metered_weight;
  };
  EXPECT_EQ(weight(l), 67u * 3u);
  EXPECT_EQ(weight(std::nextafter(l, 1.0f)), 0u);
}

// A picture between two bars, nearly black and with negative texels.
WireFrame letterboxed(uint32_t width, uint32_t picture, uint32_t bar) {
  const scenes::TexelFunction inside = [=](uint32_t x, uint32_t y) -> Texel {
    const float v = std::exp2(8 * noise(x, y, 0) - 6);
    return {v, v * (0.5f + noise(x, y, 1)), v, 1};
  };
  return make_frame(width, picture + 2 * bar, v1::PIXEL_FORMAT_RGBA16F, [=](uint32_t x, uint32_t y) -> Texel {
    if (y >= bar && y < bar + picture) return inside(x, y - bar);
    const float dark = 2e-3f * noise(x, y, 2) - 1e-3f;
    return {dark, dark, dark, 1};
  });
}

// All sums are of integers, so the bits are the same wherever the tiles begin. CENTER has another centre.
TEST_F(IgnoreBelow, ALetterboxMetersAsItsPictureAlone) {
  for (const auto& [width, picture, bar] :
       {std::tuple{128u, 128u, 64u}, {131u, 67u, 29u}, {640u, 270u, 45u}}) {
    for (const auto statistic : kStatistics) {
      for (const auto weights : {v1::Metering::WEIGHTS_AVERAGE, v1::Metering::WEIGHTS_SPOT}) {
        v1::Settings settings = metering_settings(statistic, weights, 0.005f);
        const FrameStats alone = report(letterboxed(width, picture, 0), settings).stats;
        const WireFrame boxed = letterboxed(width, picture, bar);
        const FrameStats seen = report(boxed, settings).stats;
        EXPECT_EQ(seen.metered_weight, alone.metered_weight) << width << " " << bar;
        EXPECT_EQ(seen.mean_log2_luminance, alone.mean_log2_luminance) << width << " " << bar;
        settings.mutable_exposure()->mutable_metering()->set_ignore_below(0);
        const FrameStats whole = report(boxed, settings).stats;
        EXPECT_LT(whole.mean_log2_luminance, alone.mean_log2_luminance - 0.1);
        EXPECT_EQ(seen.min_luminance, whole.min_luminance);
        EXPECT_EQ(seen.max_luminance, whole.max_luminance);
        EXPECT_EQ(seen.negative_components, whole.negative_components);
      }
    }
  }
}

TEST_F(IgnoreBelow, TheBarsAreInNoPictureOfTheScene) {
  const FrameStats stats =
      report(letterboxed(512, 384, 64), metering_settings(kStatistics[0], kWeights[0], 0.005f)).stats;
  for (size_t cell = 0; cell < stats.print.size(); ++cell) {
    EXPECT_EQ(std::isnan(stats.print[cell]), cell < 8 || cell >= 56) << cell;
  }
}

TEST_F(IgnoreBelow, BadTexelsAreMeteredAsScrubbed) {
  constexpr float kInf = std::numeric_limits<float>::infinity();
  for (const auto format : {v1::PIXEL_FORMAT_RGBA16F, v1::PIXEL_FORMAT_RGBA32F}) {
    const WireFrame frame = make_frame(67, 65, format, [](uint32_t x, uint32_t y) -> Texel {
      const float kinds[] = {NAN, -NAN, kInf, -kInf, -1.0f, -0.0f, 0.0f, 1.0f, 0.01f};
      const float v = kinds[(x + y * 67) % 9];
      return {v, v, v, 1};
    });
    for (const auto statistic : kStatistics) {
      for (const auto weights : kWeights) {
        expect_as_reference(frame, metering_settings(statistic, weights, 0.02f));
        const FrameStats seen = report(frame, metering_settings(statistic, weights, 0.02f)).stats;
        const FrameStats whole = report(frame, metering_settings(statistic, weights, 0)).stats;
        EXPECT_EQ(seen.nan_components, whole.nan_components);
        EXPECT_EQ(seen.infinite_components, whole.infinite_components);
        EXPECT_EQ(seen.negative_components, whole.negative_components);
        EXPECT_EQ(seen.max_luminance, whole.max_luminance);
        EXPECT_EQ(seen.min_luminance, 0.0f);
      }
    }
  }
}

TEST_F(IgnoreBelow, AFrameWithNothingMeteredKeepsTheExposureBeforeIt) {
  const WireFrame black = flat(67, 65, {0, 0, 0, 1});
  for (const std::string tier : {"standard", "reference"}) {
    for (const auto statistic : kStatistics) {
      for (const auto weights : kWeights) {
        v1::Settings settings = metering_settings(statistic, weights, 0.01f);
        settings.set_tier(tier);
        settings.mutable_exposure()->set_compensation_ev(1.0);
        const FrameReport first = report(black, settings);
        EXPECT_EQ(first.stats.metered_weight, 0u);
        EXPECT_EQ(first.stats.mean_log2_luminance, std::log2(0.18));
        EXPECT_NEAR(first.target, 2.0, 1e-12);  // 0.18 to a key of 0.18, and 1 EV
        EXPECT_EQ(first.exposure, first.target);
        const FrameReport later = report(black, settings, {.previous = PreviousExposure{3.0, 1e9}});
        EXPECT_EQ(later.exposure, 3.0);
        EXPECT_EQ(later.target, first.target);
        settings.mutable_exposure()->set_mode(v1::Exposure::MODE_MANUAL);
        settings.mutable_exposure()->set_manual_ev(2.0);
        EXPECT_EQ(report(black, settings, {.previous = PreviousExposure{3.0, 1.0}}).exposure, 4.0);
      }
    }
  }
}

TEST_F(IgnoreBelow, ZeroIsNoSetting) {
  const WireFrame frame = natural(131, 67);
  for (const auto statistic : kStatistics) {
    for (const auto weights : kWeights) {
      v1::Settings zero = metering_settings(statistic, weights, 0.0f);
      v1::Settings absent = zero;
      absent.mutable_exposure()->mutable_metering()->clear_ignore_below();
      ASSERT_OK_AND_ASSIGN(const auto a, render(frame, zero));
      ASSERT_OK_AND_ASSIGN(const auto b, render(frame, absent));
      EXPECT_EQ(a.report.stats.mean_log2_luminance, b.report.stats.mean_log2_luminance);
      EXPECT_EQ(a.report.stats.metered_weight, b.report.stats.metered_weight);
      EXPECT_EQ(a.report.plan.words, b.report.plan.words);
      EXPECT_EQ(image(a.memory), image(b.memory));
    }
  }
}

// Under a manual exposure there is nothing else that it could change.
TEST_F(IgnoreBelow, BloomTakesLightFromEverywhere) {
  v1::Settings settings;
  settings.mutable_exposure()->set_mode(v1::Exposure::MODE_MANUAL);
  settings.mutable_bloom()->set_threshold(0.1f);
  const WireFrame frame = lit_tiles(333, 217);
  ASSERT_OK_AND_ASSIGN(const auto whole, render(frame, settings));
  settings.mutable_exposure()->mutable_metering()->set_ignore_below(65504);
  ASSERT_OK_AND_ASSIGN(const auto ignoring, render(frame, settings));
  EXPECT_EQ(image(whole.memory), image(ignoring.memory));
  EXPECT_EQ(whole.report.stats.tile_light, ignoring.report.stats.tile_light);
}

TEST_F(IgnoreBelow, VerifiesAndSaysSo) {
  for (const auto format : {v1::PIXEL_FORMAT_RGBA16F, v1::PIXEL_FORMAT_RGBA32F}) {
    for (const auto statistic : kStatistics) {
      v1::Settings settings = metering_settings(statistic, v1::Metering::WEIGHTS_AVERAGE, 0.25f);
      settings.set_input_primaries(v1::PRIMARIES_REC2020);
      const FrameReport seen = report(natural(131, 67, format), settings, {}, Verify::kYes);
      ASSERT_TRUE(seen.verification);
      EXPECT_LE(seen.verification->rounded.meter_error_ev, 2e-5);
      EXPECT_TRUE(says(seen.plan.words.at(0), " above 0.25"));
    }
  }
}

TEST_F(IgnoreBelow, RefusesWhatIsNoLuminance) {
  const WireFrame frame = flat(4, 4, {1, 1, 1, 1});
  for (const float limit : {-1.0f, 1.1e9f, NAN}) {
    const auto refused = render(frame, metering_settings(kStatistics[0], kWeights[0], limit));
    EXPECT_REFUSED(kInvalidArgument, "exposure.metering.ignore_below", refused);
  }
}

}  // namespace
}  // namespace candela::testing
