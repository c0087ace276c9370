// Metering weights and percentiles: every texel counts, exactly once and by its own weight.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "server/render/plan/exposure.h"
#include "server/render/settings/error_bound.h"
#include "shaders/reference.h"
#include "tests/support/device_fixture.h"
#include "tests/support/settings.h"
#include "tests/support/status.h"

namespace candela::testing {
namespace {

v1::Metering weighted(v1::Metering::Weights weights) {
  v1::Metering metering;
  metering.set_weights(weights);
  return metering;
}

v1::Metering spot(const v1::Rectangle& rectangle) {
  v1::Metering metering = weighted(v1::Metering::WEIGHTS_SPOT);
  *metering.mutable_spot() = rectangle;
  return metering;
}

class Metering : public DeviceTest {
 protected:
  static FrameReport report(const WireFrame& frame, const v1::Metering& metering) {
    v1::Settings settings;
    *settings.mutable_exposure()->mutable_metering() = metering;
    settings.mutable_bloom()->set_intensity(0);
    auto rendered = render(frame, settings);
    if (!rendered.ok()) throw std::runtime_error(rendered.status().ToString());
    return rendered->report;
  }

  static reference::MeterParams params(const v1::Metering& asked) {
    v1::Settings settings;
    *settings.mutable_exposure()->mutable_metering() = asked;
    const v1::Metering m = checked(settings)->exposure().metering();
    return {m.statistic() == v1::Metering::STATISTIC_PERCENTILE,
            m.percentile_low(),
            m.percentile_high(),
            static_cast<uint32_t>(m.weights()),
            {m.spot().x0(), m.spot().y0(), m.spot().x1(), m.spot().y1()}};
  }

  // If texel (x, y) has luminance 2^4 and all others have 1, the mean is 4 times the texel's share of the sum
  // of all weights.
  static void expect_weights(uint32_t width, uint32_t height, const v1::Metering& metering) {
    const reference::MeterParams meter = params(metering);
    uint64_t total = 0;
    for (uint32_t y = 0; y < height; ++y) {
      for (uint32_t x = 0; x < width; ++x) total += reference::meter_weight(x, y, width, height, meter);
    }
    std::vector<std::pair<uint32_t, uint32_t>> places = {{width / 2, height / 3}};
    if (width <= 67 && height <= 67) places.insert(places.end(), {{0, 0}, {width - 1, height - 1}});
    for (const auto& [x, y] : places) {
      const WireFrame frame =
          make_frame(width, height, v1::PIXEL_FORMAT_RGBA16F, [=](uint32_t i, uint32_t j) -> Texel {
            const float v = i == x && j == y ? 16.0f : 1.0f;
            return {v, v, v, 1};
          });
      const FrameReport seen = report(frame, metering);
      ASSERT_EQ(seen.stats.metered_weight, total) << width << "x" << height;
      const double share = reference::meter_weight(x, y, width, height, meter) / static_cast<double>(total);
      ASSERT_NEAR(seen.stats.mean_log2_luminance, 4.0 * share, 2e-5)
          << width << "x" << height << " " << x << " " << y;
    }
  }
};

TEST_F(Metering, WeightsSumExactlyAtEverySize) {
  for (uint32_t height = 1; height <= 67; ++height) {
    for (uint32_t width = 1; width <= 67; ++width) {
      expect_weights(width, height, weighted(v1::Metering::WEIGHTS_CENTER));
      expect_weights(width, height, spot(rectangle(width / 3, height / 4, width / 3 + 9, height)));
    }
  }
}

TEST_F(Metering, WeightsSumExactlyAtLargeSizes) {
  for (const auto& [width, height] :
       {std::pair{1919u, 1081u}, {3840u, 2160u}, {7680u, 4320u}, {16384u, 3u}, {5u, 16384u}}) {
    expect_weights(width, height, weighted(v1::Metering::WEIGHTS_CENTER));
    expect_weights(width, height, spot(rectangle(1, 1, width - 1, 1u << 30)));
  }
}

// The definition, literally: all texels in order of luminance, and each texel's weight is a step on the way
// from 0 to 1.
double sorted_percentile_mean(const reference::Scene& scene, const v1::Metering& metering) {
  std::vector<std::pair<double, double>> texels;  // log2 luminance, weight
  double total = 0.0;
  for (uint32_t y = 0; y < scene.height; ++y) {
    for (uint32_t x = 0; x < scene.width; ++x) {
      const auto& c = scene.at(x, y);
      const double l = 0.2126 * c[0] + 0.7152 * c[1] + 0.0722 * c[2];
      const double whole = reference::meter_weight(
          x, y, scene.width, scene.height,
          {false,
           0,
           0,
           static_cast<uint32_t>(metering.weights()),
           {metering.spot().x0(), metering.spot().y0(), metering.spot().x1(), metering.spot().y1()}});
      // By its alpha in 255 steps, rounded with the weights that have as many.
      const double covered = whole * static_cast<double>(std::lround(255.0 * c[3])) / 255.0;
      const double weight =
          metering.weights() == v1::Metering::WEIGHTS_CENTER ? std::round(covered) : covered;
      texels.emplace_back(std::log2(std::max(l, 1e-4)), weight);
      total += weight;
    }
  }
  std::sort(texels.begin(), texels.end());
  const double low = metering.percentile_low() / 100 * total;
  const double high = metering.percentile_high() / 100 * total;
  double below = 0.0;
  double sum = 0.0;
  for (const auto& [value, weight] : texels) {
    sum += value * std::max(0.0, std::min(high, below + weight) - std::max(low, below));
    below += weight;
  }
  return sum / (high - low);
}

TEST_F(Metering, PercentilesAreWithinTheirPartOfABinOfTheSortedDefinition) {
  for (const auto& [width, height] : {std::pair{1u, 1u}, {3u, 5u}, {67u, 35u}, {641u, 359u}}) {
    const WireFrame frame = natural(width, height);
    reference::BadCounts bad;
    const reference::Scene scene =
        reference::ingest(frame.pixels, frame.desc.row_bytes(), width, height, shader::PIXELS_RGBA16F,
                          std::nullopt, reference::Rounding::kHalf, &bad);
    for (v1::Metering::Weights weights :
         {v1::Metering::WEIGHTS_AVERAGE, v1::Metering::WEIGHTS_CENTER, v1::Metering::WEIGHTS_SPOT}) {
      for (const auto& [low, high] :
           {std::pair{10.0, 90.0}, {0.0, 100.0}, {50.0, 50.1}, {99.0, 100.0}, {0.0, 1.0}}) {
        v1::Metering metering = weighted(weights);
        metering.set_statistic(v1::Metering::STATISTIC_PERCENTILE);
        metering.set_percentile_low(low);
        metering.set_percentile_high(high);
        *metering.mutable_spot() = rectangle(0, 0, 30, 20);
        EXPECT_NEAR(report(frame, metering).stats.mean_log2_luminance,
                    sorted_percentile_mean(scene, metering),
                    std::max(low / high, (100 - high) / (100 - low)) / 64 + 2e-5)
            << width << "x" << height << " " << low << " .. " << high;
      }
    }
  }
}

// A few texels whose luminance is a hair below the edge of a bin, and many at the upper end of that bin or of
// the one above. The device's logarithm is on the other side of the edge than the reference's.
TEST_F(Metering, APercentileIsWithinItsErrorOfTheReferences) {
  const WireFrame frame = make_frame(200, 200, v1::PIXEL_FORMAT_RGBA16F, [](uint32_t x, uint32_t) -> Texel {
    if (x < 3) return {1.7998046875f, 0.91259765625f, 1.7783203125f, 1};
    return {1.17578125f, 1.17578125f, 1.17578125f, 1};
  });
  v1::Metering metering;
  metering.set_statistic(v1::Metering::STATISTIC_PERCENTILE);
  metering.set_percentile_low(0);
  metering.set_percentile_high(1);
  reference::BadCounts bad;
  const reference::Scene scene =
      reference::ingest(frame.pixels, frame.desc.row_bytes(), 200, 200, shader::PIXELS_RGBA16F, std::nullopt,
                        reference::Rounding::kHalf, &bad);
  const double metered = report(frame, metering).stats.mean_log2_luminance;
  const double expected = reference::meter(scene, {true, 0, 1, static_cast<uint32_t>(metering.weights()), {}})
                              .mean_log2_luminance;
  EXPECT_NEAR(metered, expected, mean_error(metering));
  EXPECT_GT(std::abs(metered - expected), 1.0 / 128) << "the frame shows nothing";
}

// Luminance is defined in float32, and so is what is left of it where components cancel.
TEST_F(Metering, LightThatCancelsHasTheReferencesLuminance) {
  const Texel cancels = {65504.0f, -19472.0f, 3.111328125f, 1};
  const WireFrame frame = flat(64, 64, cancels);
  reference::BadCounts bad;
  const reference::Scene scene =
      reference::ingest(frame.pixels, frame.desc.row_bytes(), 64, 64, shader::PIXELS_RGBA16F, std::nullopt,
                        reference::Rounding::kHalf, &bad);
  const v1::Metering metering;
  const double expected =
      reference::meter(scene, {false, 0, 1, static_cast<uint32_t>(metering.weights()), {}})
          .mean_log2_luminance;
  EXPECT_NEAR(report(frame, metering).stats.mean_log2_luminance, expected, mean_error(metering));
}

TEST_F(Metering, PercentilesFollowASlowFadeWithoutSteps) {
  double last = -100.0;
  for (int step = 0; step < 200; ++step) {
    const auto v = static_cast<float>(0.18 * std::exp2(step / 1000.0));
    const WireFrame frame =
        make_frame(64, 64, v1::PIXEL_FORMAT_RGBA32F, [=](uint32_t x, uint32_t y) -> Texel {
          const float c = v * (0.5f + noise(x, y, 0));
          return {c, c, c, 1};
        });
    v1::Metering percentile;
    percentile.set_statistic(v1::Metering::STATISTIC_PERCENTILE);
    const double mean = report(frame, percentile).stats.mean_log2_luminance;
    // A step of the fade is 1/1000 EV. Halves round each texel, but the mean of thousands averages that out.
    if (step > 0) {
      EXPECT_NEAR(mean - last, 1.0 / 1000, 3e-4) << step;
    }
    last = mean;
  }
}

TEST_F(Metering, ASpotBesideTheFrameIsRefused) {
  v1::Settings settings;
  settings.mutable_exposure()->mutable_metering()->set_weights(v1::Metering::WEIGHTS_SPOT);
  *settings.mutable_exposure()->mutable_metering()->mutable_spot() = rectangle(64, 0, 65, 1);
  EXPECT_OK(Settings::from(settings));
  EXPECT_OK(check_settings_for(checked(settings), {65, 1, v1::PIXEL_FORMAT_RGBA16F}, v1::kMaxDimension));
  EXPECT_EQ(
      check_settings_for(checked(settings), {64, 64, v1::PIXEL_FORMAT_RGBA16F}, v1::kMaxDimension).message(),
      "exposure.metering.spot begins at x 64, y 0, beside the frame of 64x64 pixels");
  *settings.mutable_exposure()->mutable_metering()->mutable_spot() = rectangle(3, 3, 3, 9);
  EXPECT_EQ(Settings::from(settings).status().code(), absl::StatusCode::kInvalidArgument);
}

// metering.ignore_below: dark texels are not metered, and a frame that has no others keeps its exposure.

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
