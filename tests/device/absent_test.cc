// Absent pixels, with alpha 0 and no light, are not metered: docs/pipeline.md sections 1 and 2.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "server/render/plan/exposure.h"
#include "shaders/reference.h"
#include "tests/support/device_fixture.h"
#include "tests/support/settings.h"
#include "tests/support/status.h"

namespace candela::testing {
namespace {

// A disc with a soft edge in the middle of nothing.
scenes::TexelFunction disc(uint32_t width, uint32_t height) {
  return [=](uint32_t x, uint32_t y) -> Texel {
    const float dx = 2 * static_cast<float>(x) - static_cast<float>(width);
    const float dy = 2 * static_cast<float>(y) - static_cast<float>(height);
    const float r = std::sqrt(dx * dx + dy * dy) / static_cast<float>(std::max(width, height));
    const float a = std::clamp(8 * (0.7f - r), 0.0f, 1.0f);
    if (a == 0) return {0, 0, 0, 0};
    const float v = a * std::exp2(6 * noise(x, y, 0) - 5);
    return {v, v * noise(x, y, 1), v, a};
  };
}

class Absent : public DeviceTest {
 protected:
  static FrameReport report(const WireFrame& frame, const v1::Settings& settings,
                            const FrameMoment& moment = {}, Verify verify = Verify::kNo) {
    auto rendered = render(frame, settings, moment, verify);
    if (!rendered.ok()) throw std::runtime_error(rendered.status().ToString());
    return rendered->report;
  }

  // Against the reference, with every texel of weight 0 counted once more by the plain definition.
  static void expect_as_reference(const WireFrame& frame, const v1::Settings& settings) {
    SCOPED_TRACE(::testing::Message() << frame.desc.width << "x" << frame.desc.height << " "
                                      << settings.exposure().metering().ShortDebugString());
    const v1::Metering& metering = settings.exposure().metering();
    const reference::MeterParams params = {
        .percentile = metering.statistic() == v1::Metering::STATISTIC_PERCENTILE,
        .weights = static_cast<uint32_t>(metering.weights()),
        .spot = {metering.spot().x0(), metering.spot().y0(), metering.spot().x1(), metering.spot().y1()},
        .ignore_below = metering.ignore_below()};
    reference::BadCounts bad;
    const reference::Scene scene = reference::ingest(
        frame.pixels, frame.desc.row_bytes(), frame.desc.width, frame.desc.height,
        static_cast<uint32_t>(frame.desc.format), std::nullopt, reference::Rounding::kHalf, &bad);
    const reference::Meter truth = reference::meter(scene, params);
    const FrameStats stats = report(frame, settings).stats;
    EXPECT_EQ(stats.absent_pixels, truth.absent);
    EXPECT_EQ(stats.metered_weight, truth.weight);
    EXPECT_NEAR(stats.mean_log2_luminance, truth.mean_log2_luminance, 2e-5);
    EXPECT_FLOAT_EQ(stats.max_luminance, static_cast<float>(truth.max_luminance));
  }
};

TEST_F(Absent, MetersWhatTheReferenceMeters) {
  for (const auto& [width, height] :
       {std::pair{1u, 1u}, {3u, 5u}, {63u, 65u}, {64u, 64u}, {131u, 67u}, {641u, 359u}}) {
    const auto format = width % 2 == 0 ? v1::PIXEL_FORMAT_RGBA32F : v1::PIXEL_FORMAT_RGBA16F;
    const WireFrame frame = make_frame(width, height, format, disc(width, height));
    for (const auto statistic : kStatistics) {
      for (const auto weights : kWeights) {
        for (const float limit : {0.0f, 0.05f}) {
          expect_as_reference(frame, metering_settings(statistic, weights, limit));
        }
      }
    }
  }
}

TEST_F(Absent, IsDecidedOnTheWireAfterTheScrub) {
  constexpr float kInf = std::numeric_limits<float>::infinity();
  struct Case {
    Texel texel;
    bool absent;
  };
  const Case cases[] = {
      {{0, 0, 0, 0}, true},      {{-0.0f, 0, 0, -0.0f}, true}, {{0, 0, 0, -1}, true},
      {{0, 0, 0, NAN}, true},    {{NAN, 0, -NAN, 0}, true},    {{0, 0, 0, -kInf}, true},
      {{0, 0, 0, kInf}, false},  {{0, kInf, 0, 0}, false},     {{0, 0, 0, 1}, false},
      {{0, 0, 6e-8f, 0}, false}, {{0, 0, -6e-8f, 0}, false},   {{0, 0, 0, 6e-8f}, false},
  };
  for (const auto format : {v1::PIXEL_FORMAT_RGBA16F, v1::PIXEL_FORMAT_RGBA32F}) {
    for (const Case& c : cases) {
      // Beside an opaque texel, so that something is metered.
      const WireFrame frame = make_frame(5, 3, format, [&](uint32_t x, uint32_t y) -> Texel {
        return x == 3 && y == 1 ? c.texel : Texel{1, 1, 1, 1};
      });
      const FrameStats stats = report(frame, metering_settings(kStatistics[0], kWeights[0])).stats;
      EXPECT_EQ(stats.absent_pixels, c.absent ? 1u : 0u) << c.texel[0] << " " << c.texel[3];
      EXPECT_EQ(stats.metered_weight, c.texel[3] < 0.5f || c.absent ? 14u : 15u)
          << c.texel[0] << " " << c.texel[3];
      expect_as_reference(frame, metering_settings(kStatistics[0], kWeights[0]));
    }
  }
  // Floats that round to nothing are something.
  for (const Texel& texel : {Texel{1e-30f, 0, 0, 0}, Texel{0, 0, 0, 1e-30f}, Texel{1e-44f, 0, 0, 0}}) {
    const WireFrame frame = flat(5, 3, texel, v1::PIXEL_FORMAT_RGBA32F);
    EXPECT_EQ(report(frame, metering_settings(kStatistics[0], kWeights[0])).stats.absent_pixels, 0u)
        << texel[0];
  }
}

// Whole tiles and pieces of them, beside the object and around it.
TEST_F(Absent, AnObjectOnNothingMetersAsTheObjectAlone) {
  constexpr uint32_t kWidth = 131, kHeight = 97;
  const auto object = [](uint32_t x, uint32_t y) -> Texel {
    const float v = std::exp2(8 * noise(x, y, 0) - 6);
    return {v, v * (0.5f + noise(x, y, 1)), v, 1};
  };
  const WireFrame alone = make_frame(kWidth, kHeight, v1::PIXEL_FORMAT_RGBA16F, object);
  for (const auto& [left, top] : {std::pair{0u, 0u}, {64u, 64u}, {29u, 131u}}) {
    const WireFrame placed = make_frame(kWidth + 2 * left + 67, kHeight + 2 * top, v1::PIXEL_FORMAT_RGBA16F,
                                        [&, left = left, top = top](uint32_t x, uint32_t y) -> Texel {
                                          const bool inside =
                                              x >= left && x < left + kWidth && y >= top && y < top + kHeight;
                                          return inside ? object(x - left, y - top) : Texel{0, 0, 0, 0};
                                        });
    for (const auto statistic : kStatistics) {
      const v1::Settings settings = metering_settings(statistic, v1::Metering::WEIGHTS_AVERAGE);
      const FrameReport a = report(alone, settings), b = report(placed, settings);
      EXPECT_EQ(a.stats.mean_log2_luminance, b.stats.mean_log2_luminance);
      EXPECT_EQ(a.exposure, b.exposure);
      EXPECT_EQ(a.stats.metered_weight, b.stats.metered_weight);
      EXPECT_EQ(b.stats.absent_pixels, uint64_t{placed.desc.width} * placed.desc.height - kWidth * kHeight);
      EXPECT_EQ(b.stats.min_luminance, 0.0f);
    }
  }
}

// A pixel counts by its alpha in 255 steps.
TEST_F(Absent, CoverageIsTheWeight) {
  const auto mean = [](const WireFrame& frame, v1::Metering::Weights weights = kWeights[0]) {
    return report(frame, metering_settings(kStatistics[0], weights)).stats.mean_log2_luminance;
  };
  // Light of 16 beside light of 1 with the alphas a and b.
  const auto pair = [](float a, float b) {
    return make_frame(128, 64, v1::PIXEL_FORMAT_RGBA32F, [=](uint32_t x, uint32_t) -> Texel {
      return x % 2 == 0 ? Texel{16, 16, 16, a} : Texel{1, 1, 1, b};
    });
  };
  EXPECT_NEAR(mean(pair(0.5f, 1)), 4.0 * 128 / (128 + 255), 2e-5);
  EXPECT_NEAR(mean(pair(1, 0.25f)), 4.0 * 255 / (255 + 64), 2e-5);
  EXPECT_NEAR(mean(pair(7, 0.25f)), 4.0 * 255 / (255 + 64), 2e-5);  // cut to 1
  EXPECT_NEAR(mean(pair(0, 0.25f)), 0.0, 2e-5);                     // a flame covers nothing
  EXPECT_NEAR(mean(pair(-3, 0.001f)), 2.0, 2e-5);                   // none is above 0 in 255 steps
  EXPECT_NEAR(mean(pair(0, 0)), 2.0, 2e-5);
  EXPECT_NEAR(mean(pair(NAN, 1)), 0.0, 2e-5);
  // Whatever is metered, light stays as it stands in the file.
  for (const auto weights : kWeights) {
    EXPECT_NEAR(mean(flat(97, 65, {0.5f, 0.5f, 0.5f, 0.125f}), weights), -1.0, 2e-5);
    EXPECT_NEAR(mean(flat(97, 65, {0.5f, 0.5f, 0.5f, 0}), weights), -1.0, 2e-5);
  }
}

TEST_F(Absent, CoverageIsAsTheReferenceHasItAndIgnoredIfAlphaIs) {
  for (const auto format : {v1::PIXEL_FORMAT_RGBA16F, v1::PIXEL_FORMAT_RGBA32F}) {
    for (const auto& [scale, least] : {std::pair{1.0f, 0.0f}, {4.0f, 0.0f}, {0.004f, 0.0f}, {1.0f, -0.9f}}) {
      const WireFrame frame =
          make_frame(331, 207, format, [&, scale = scale, least = least](uint32_t x, uint32_t y) -> Texel {
            const float a = std::max(0.0f, least + scale * noise(x, y, 3));
            const float v = std::exp2(12 * noise(x, y, 0) - 9);
            return {v, v * noise(x, y, 1), noise(x, y, 2) < 0.1f ? 3e5f * v : v, a};
          });
      for (const auto statistic : kStatistics) {
        for (const auto weights : kWeights) {
          expect_as_reference(frame, metering_settings(statistic, weights));
          expect_as_reference(frame, metering_settings(statistic, weights, 0.05f));
        }
      }
      v1::Settings settings = metering_settings(kStatistics[0], kWeights[0]);
      settings.set_alpha(v1::ALPHA_IGNORE);
      EXPECT_EQ(report(frame, settings).stats.metered_weight, 331u * 207u);
    }
  }
}

TEST_F(Absent, OverflowsNoSumWithTheLargestWeights) {
  for (const float alpha : {1.0f, 0.998f}) {
    const WireFrame frame =
        make_frame(512, 512, v1::PIXEL_FORMAT_RGBA32F, [=](uint32_t x, uint32_t) -> Texel {
          return {0x1p30f, 0x1p30f, 0x1p30f, x == 0 ? 0.5f : alpha};
        });
    for (const auto statistic : kStatistics) {
      for (const auto weights : kWeights) {
        const FrameStats stats = report(frame, metering_settings(statistic, weights)).stats;
        EXPECT_NEAR(stats.mean_log2_luminance, 30.0, 8e-6) << alpha;
      }
    }
  }
}

TEST_F(Absent, TheyAreInNoPictureOfTheScene) {
  const WireFrame frame = make_frame(512, 512, v1::PIXEL_FORMAT_RGBA16F, [](uint32_t, uint32_t y) -> Texel {
    return y < 64 ? Texel{0, 0, 0, 0} : Texel{1, 1, 1, 1};
  });
  const FrameStats stats = report(frame, metering_settings(kStatistics[0], kWeights[0])).stats;
  for (size_t cell = 0; cell < stats.print.size(); ++cell) {
    EXPECT_EQ(std::isnan(stats.print[cell]), cell < 8) << cell;
  }
}

TEST_F(Absent, AFrameOfNothingKeepsTheExposureBeforeIt) {
  const WireFrame nothing = flat(67, 65, {0, 0, 0, 0});
  for (const std::string tier : {"standard", "reference"}) {
    for (const auto statistic : kStatistics) {
      for (const auto weights : kWeights) {
        v1::Settings settings = metering_settings(statistic, weights);
        settings.set_tier(tier);
        const FrameReport first = report(nothing, settings);
        EXPECT_EQ(first.stats.metered_weight, 0u);
        EXPECT_EQ(first.stats.absent_pixels, 67u * 65u);
        EXPECT_EQ(first.stats.mean_log2_luminance, std::log2(0.18));
        EXPECT_EQ(report(nothing, settings, {.previous = PreviousExposure{3.0, 1e9}}).exposure, 3.0);
        settings.set_alpha(v1::ALPHA_IGNORE);  // then it is black
        EXPECT_EQ(report(nothing, settings).exposure, 64.0);
      }
    }
  }
}

// Alphas and magnitudes share a word of the first read.
TEST_F(Absent, AnIgnoredAlphaHidesNoBadValue) {
  for (const auto format : {v1::PIXEL_FORMAT_RGBA16F, v1::PIXEL_FORMAT_RGBA32F}) {
    for (const float bad :
         {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity()}) {
      const auto frame = [&](float alpha) {
        return make_frame(67, 65, format, [=](uint32_t x, uint32_t y) -> Texel {
          const float v = x == 3 && y == 40 ? bad : noise(x, y, 0);
          return {v, noise(x, y, 1), noise(x, y, 2), alpha};
        });
      };
      v1::Settings settings = metering_settings(kStatistics[0], kWeights[0]);
      settings.set_alpha(v1::ALPHA_IGNORE);
      ASSERT_OK_AND_ASSIGN(auto ignored, render(frame(0.5f), settings));
      ASSERT_OK_AND_ASSIGN(auto opaque, render(frame(1.0f), settings));
      EXPECT_EQ(ignored.report.stats.nan_components, std::isnan(bad) ? 1u : 0u);
      EXPECT_EQ(ignored.report.stats.infinite_components, std::isinf(bad) ? 1u : 0u);
      EXPECT_EQ(image(ignored.memory), image(opaque.memory));
      settings.set_bad_values(v1::BAD_VALUES_REJECT);
      EXPECT_FALSE(render(frame(0.5f), settings).ok());
    }
  }
}

TEST_F(Absent, VerifiesInEveryTierAndWithoutRounding) {
  for (const std::string tier : {"draft", "standard", "reference"}) {
    for (const auto format : {v1::PIXEL_FORMAT_RGBA16F, v1::PIXEL_FORMAT_RGBA32F}) {
      v1::Settings settings = metering_settings(kStatistics[0], kWeights[0]);
      settings.set_tier(tier);
      settings.set_input_primaries(v1::PRIMARIES_ACES_AP0);
      const FrameReport seen = report(make_frame(131, 67, format, disc(131, 67)), settings, {}, Verify::kYes);
      EXPECT_LE(seen.verification->rounded.meter_error_ev, 2e-5) << tier;
      EXPECT_LE(seen.verification->unrounded.meter_error_ev, 1e-3) << tier;
      EXPECT_EQ(seen.verification->truth.absent_pixels, seen.stats.absent_pixels) << tier;
      EXPECT_GT(seen.stats.absent_pixels, 1000u);
      EXPECT_TRUE(says(seen.plan.words.at(1), "pixels are absent"));
    }
  }
}

}  // namespace
}  // namespace candela::testing
