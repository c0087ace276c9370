// Metering weights and percentiles: every texel counts, exactly once and by its own weight.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

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

}  // namespace
}  // namespace candela::testing
