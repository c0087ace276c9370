// Light beyond the largest half, up to 2^30, is metered, bloomed and exposed as it is: docs/pipeline.md
// sections 1 and 2.
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <random>
#include <stdexcept>

#include "proto/candela/v1/settings.h"
#include "server/render/plan/exposure.h"
#include "shaders/reference.h"
#include "tests/support/device_fixture.h"
#include "tests/support/frame_error.h"
#include "tests/support/settings.h"
#include "tests/support/status.h"

namespace candela::testing {
namespace {

constexpr float kMost = 0x1p30f;

// natural() with suns of up to 2^30 in it. Some pixels have one bright component.
TexelFunction suns(uint32_t width, uint32_t height) {
  return [scene = ordinary(scenes::natural(width, height))](uint32_t x, uint32_t y) -> Texel {
    const Texel c = scene(x, y);
    const float sun = std::exp2(16.0f + 14.0f * noise(x, y, 7));
    if (noise(x / 5, y / 5, 8) < 0.05f) return {sun, 0.9f * sun, 0.8f * sun, 1};
    if (noise(x, y, 9) < 0.01f) return {c[0], sun, c[2], 1};
    return c;
  };
}

class AllLight : public FrameErrorTest {
 protected:
  static Rendered must_render(const WireFrame& frame, const v1::Settings& settings = {}) {
    auto rendered = render(frame, settings);
    if (!rendered.ok()) throw std::runtime_error(rendered.status().ToString());
    return *std::move(rendered);
  }
  static FrameStats stats_of(const WireFrame& frame, const v1::Settings& settings) {
    return must_render(frame, settings).report.stats;
  }
};

TEST_F(AllLight, IsMeteredAsItIs) {
  const WireFrame frame = make_frame(128, 64, v1::PIXEL_FORMAT_RGBA32F, [](uint32_t x, uint32_t) -> Texel {
    const float v = x < 64 ? 1e6f : 20000.0f;
    return {v, v, v, 1};
  });
  const FrameStats stats = stats_of(frame, {});
  EXPECT_NEAR(stats.mean_log2_luminance, (std::log2(1e6) + std::log2(20000.0)) / 2, 8e-6);
  EXPECT_NEAR(stats.max_luminance, 1e6f, 1);
  EXPECT_EQ(stats.clamped_components, 0u);
}

TEST_F(AllLight, IsMeteredWithinTheBoundWithEveryStatisticAndWeight) {
  for (const Size& size : {Size{1, 1}, Size{67, 35}, Size{641, 359}}) {
    const WireFrame frame =
        make_frame(size.width, size.height, v1::PIXEL_FORMAT_RGBA32F, suns(size.width, size.height));
    reference::BadCounts bad;
    const reference::Scene scene =
        reference::ingest(frame.pixels, frame.desc.row_bytes(), size.width, size.height,
                          shader::PIXELS_RGBA32F, std::nullopt, reference::Rounding::kHalf, &bad);
    for (const auto statistic : kStatistics) {
      for (const auto weights : kWeights) {
        const reference::Meter truth =
            reference::meter(scene, {.percentile = statistic == v1::Metering::STATISTIC_PERCENTILE,
                                     .weights = static_cast<uint32_t>(weights),
                                     .spot = {0, 0, 40, 5000}});
        const FrameStats stats = stats_of(frame, metering_settings(statistic, weights));
        EXPECT_NEAR(stats.mean_log2_luminance, truth.mean_log2_luminance, 2e-5) << size.width;
        EXPECT_FLOAT_EQ(stats.max_luminance, static_cast<float>(truth.max_luminance));
        EXPECT_EQ(stats.metered_weight, truth.weight);
      }
    }
  }
}

// 64 tiles, which one copy of the histogram serves, with the largest weights in their middle.
TEST_F(AllLight, OverflowsNoSumWhereEverythingIsTheMost) {
  for (const float value : {kMost, std::nextafter(kMost, 0.0f), 65505.0f}) {
    const WireFrame frame = flat(512, 512, {value, value, value, 1}, v1::PIXEL_FORMAT_RGBA32F);
    for (const auto statistic : kStatistics) {
      for (const auto weights : kWeights) {
        const FrameStats stats = stats_of(frame, metering_settings(statistic, weights));
        EXPECT_NEAR(stats.mean_log2_luminance, std::log2(value), 8e-6) << value;
      }
    }
  }
}

TEST_F(AllLight, ChangesNoOtherPixelsAndIsRoundedNowhereElse) {
  v1::Settings settings = at_ev(0);
  settings.mutable_bloom()->set_intensity(0);
  const auto scene = [](float sun) {
    return make_frame(131, 67, v1::PIXEL_FORMAT_RGBA32F, [=](uint32_t x, uint32_t y) -> Texel {
      if (x == 70 && y == 33) return {sun, sun, sun, 1};
      return {noise(x, y, 0), noise(x, y, 1), noise(x, y, 2), 1};
    });
  };
  const std::vector<std::byte> without = image(must_render(scene(0.5f), settings).memory);
  for (const float sun : {65505.0f, 5e5f, kMost, -5e5f}) {
    std::vector<std::byte> with = image(must_render(scene(sun), settings).memory);
    const size_t at = 4 * (33 * 131 + 70);
    std::memcpy(&with[at], &without[at], 4);
    EXPECT_EQ(with, without) << sun;
  }
}

TEST_F(AllLight, IsExposedAndBloomedWithinTheBound) {
  print_header("suns of up to 2^30");
  for (const auto kind : {v1::Bloom::KIND_MIP, v1::Bloom::KIND_CONSERVE, v1::Bloom::KIND_GAUSSIAN}) {
    for (const double ev : {-30.0, -20.0, -6.0}) {
      for (const auto curve : {v1::TONE_CURVE_LINEAR, v1::TONE_CURVE_ACES_HILL}) {
        v1::Settings settings = at_ev(ev);
        settings.mutable_bloom()->set_kind(kind);
        settings.set_curve(curve);
        check(make_frame(333, 129, v1::PIXEL_FORMAT_RGBA32F, suns(333, 129)), settings,
              v1::word_of(kind) + " at " + std::to_string(ev));
      }
    }
  }
  check(make_frame(67, 35, v1::PIXEL_FORMAT_RGBA32F,
                   [](uint32_t x, uint32_t y) -> Texel {
                     const float v = (x + y) % 2 == 0 ? 0.0f : kMost;
                     return {v, v, v, 1};
                   }),
        at_ev(-30), "checkerboard of 0 and 2^30");
}

TEST_F(AllLight, KeepsTheHueOfASun) {
  v1::Settings settings = at_ev(-20);
  settings.mutable_bloom()->set_intensity(0);
  settings.set_curve(v1::TONE_CURVE_LINEAR);
  settings.set_output_format(v1::OUTPUT_FORMAT_RGBA16F);
  const WireFrame frame = flat(9, 5, {5e5f, 4e5f, 3e5f, 1}, v1::PIXEL_FORMAT_RGBA32F);
  const Rendered rendered = must_render(frame, settings);
  const float expected[] = {0.4768f, 0.3815f, 0.2861f};
  for (size_t k = 0; k < 3; ++k) {
    uint16_t half;
    std::memcpy(&half, &rendered.memory.output_row(2)[8 * 4 + 2 * k], sizeof half);
    EXPECT_NEAR(std::ldexp((half & 1023) + 1024, (half >> 10) - 25), expected[k], 3e-4);
  }
}

// AP0's matrix takes blue beyond what halves and RGB9E5 hold.
TEST_F(AllLight, ThatAMatrixMakesIsKept) {
  for (const v1::PixelFormat format :
       {v1::PIXEL_FORMAT_RGBA16F, v1::PIXEL_FORMAT_RGBA32F, v1::PIXEL_FORMAT_RGB9E5}) {
    const WireFrame frame = make_frame(67, 35, format, [](uint32_t x, uint32_t y) -> Texel {
      const float v = 60000.0f + 4096.0f * noise(x, y, 0);
      return x < 30 ? Texel{v, 0.25f * v, 0.125f * v, 1} : Texel{0.5f, 0.25f, 0.5f, 1};
    });
    v1::Settings settings = at_ev(-18);
    settings.set_input_primaries(v1::PRIMARIES_ACES_AP0);
    const FrameStats stats = stats_of(frame, settings);
    EXPECT_GT(stats.max_luminance, 0.2126f * 100000) << format;  // red is over 130000
    check(frame, settings, "AP0 " + v1::word_of(format));
  }
}

TEST_F(AllLight, BeyondTwoToTheThirtiethIsCutAndCounted) {
  const WireFrame frame = make_frame(131, 67, v1::PIXEL_FORMAT_RGBA32F, [](uint32_t x, uint32_t y) -> Texel {
    if (y == 40 && x < 3) return {1e30f, -2e9f, x == 2 ? INFINITY : 1.0f, 1};
    return {1, 1, 1, 1};
  });
  const FrameStats stats = stats_of(frame, {});
  EXPECT_EQ(stats.clamped_components, 6u);
  EXPECT_EQ(stats.infinite_components, 1u);
  EXPECT_EQ(stats.negative_components, 3u);
  // Without a matrix each is counted on the wire; one that the matrix makes is counted after it.
  v1::Settings settings;
  settings.set_input_primaries(v1::PRIMARIES_ACES_AP0);
  const WireFrame red = flat(9, 5, {0.75f * kMost, 0, 0, 1}, v1::PIXEL_FORMAT_RGBA32F);
  EXPECT_EQ(stats_of(red, settings).clamped_components, 45u);
  EXPECT_EQ(stats_of(red, {}).clamped_components, 0u);
}

TEST_F(AllLight, RejectRefusesWhatIsBeyondTwoToTheThirtiethAndNothingBelow) {
  v1::Settings settings;
  settings.set_bad_values(v1::BAD_VALUES_REJECT);
  const auto frame = [](float sun) {
    return make_frame(200, 150, v1::PIXEL_FORMAT_RGBA32F, [=](uint32_t x, uint32_t y) -> Texel {
      return {1, x == 66 && y == 70 ? sun : 1, 1, 1};
    });
  };
  for (const float sun : {5e5f, kMost, -kMost}) EXPECT_OK(render(frame(sun), settings)) << sun;
  const absl::Status status = render(frame(1.1e9f), settings).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(
      status.message(),
      "the pixel at x 66, y 70 is not within 2^30 (1 component beyond 2^30 in all); repair the frame or "
      "use bad_values SCRUB");
}

TEST_F(AllLight, IgnoreBelowAndThresholdsGoAsFar) {
  const WireFrame frame = make_frame(64, 64, v1::PIXEL_FORMAT_RGBA32F, [](uint32_t x, uint32_t) -> Texel {
    const float v = x < 32 ? 1e6f : 1e5f;
    return {v, v, v, 1};
  });
  const auto limit = metering_settings(kStatistics[0], kWeights[0], 5e5f);
  EXPECT_NEAR(stats_of(frame, limit).mean_log2_luminance, std::log2(1e6), 8e-6);
  v1::Settings settings = at_ev(-20);
  settings.mutable_bloom()->set_threshold(2.5e6f);  // with its knee 1.25e6
  EXPECT_FALSE(must_render(frame, settings).report.plan.bloom());
  settings.mutable_bloom()->set_threshold(5e5f);
  EXPECT_TRUE(must_render(frame, settings).report.plan.bloom());
}

// The histogram of a frame has the octaves beyond the halves only if it has light there.
TEST_F(AllLight, IsInTheHistogram) {
  const auto histogram = [](Texel texel) {
    v1::Settings message = metering_settings(v1::Metering::STATISTIC_PERCENTILE, kWeights[0]);
    const Settings settings = checked(message).for_metering(/*histogram=*/true);
    const WireFrame frame = flat(9, 5, texel, v1::PIXEL_FORMAT_RGBA32F);
    absl::StatusOr<FrameMemory> memory = renderer().allocate(frame.desc, settings);
    for (uint32_t y = 0; y < 5; ++y) {
      std::memcpy(memory->input_row(y).data(), &frame.pixels[y * frame.desc.row_bytes()],
                  frame.desc.row_bytes());
    }
    return renderer().meter(*memory, settings)->stats.histogram;
  };
  EXPECT_EQ(histogram({1, 1, 1, 1}).size(), 30u * kHistogramBinsPerEv);
  EXPECT_EQ(histogram({INFINITY, 1, 1, 1}).size(), 30u * kHistogramBinsPerEv);
  const std::vector<uint64_t> bright = histogram({kMost, kMost, kMost, 1});
  ASSERT_EQ(bright.size(), 45u * kHistogramBinsPerEv);
  EXPECT_EQ(bright[44 * kHistogramBinsPerEv], 45u);
}

// Rendering bloom only in the area that light reaches changes no bit.

class SparseBloom : public DeviceTest {
 protected:
  // The image if every tile counts as lit, so that every pass writes its whole level.
  static std::vector<std::byte> dense(const WireFrame& frame, const v1::Settings& settings) {
    absl::StatusOr<FrameMemory> memory = renderer().allocate(frame.desc, checked(settings));
    EXPECT_OK(memory);
    for (uint32_t y = 0; y < frame.desc.height; ++y) {
      std::copy_n(frame.pixels.begin() + static_cast<std::ptrdiff_t>(y * frame.desc.row_bytes()),
                  frame.desc.row_bytes(), memory->input_row(y).begin());
    }
    absl::StatusOr<Metered> metered = renderer().meter(*memory, checked(settings));
    EXPECT_OK(metered);
    for (float& light : metered->stats.tile_light) light = std::numeric_limits<float>::infinity();
    const Exposed exposed =
        expose(checked(settings)->exposure(), std::nullopt, metered->stats.mean_log2_luminance);
    const auto report = renderer().draw(*memory, checked(settings), 0, *metered, exposed);
    EXPECT_OK(report);
    return image(*memory);
  }

  // If `sparse`, also checks that a part of the frame was left out.
  static void expect_same(const WireFrame& frame, const v1::Settings& settings, bool sparse,
                          const std::string& what) {
    ASSERT_OK_AND_ASSIGN(const auto rendered, render(frame, settings));
    uint64_t lit = 0;
    for (const Box& box : rendered.report.plan.lit) lit += uint64_t{box.x1 - box.x0} * (box.y1 - box.y0);
    EXPECT_EQ(lit < uint64_t{frame.desc.width} * frame.desc.height, sparse) << what;
    EXPECT_EQ(image(rendered.memory), dense(frame, settings)) << what;
  }
};

TEST_F(SparseBloom, IsTheDenseOneWhateverTheKindAndTheTier) {
  const Texel white = {900, 700, 400, 1};
  for (const v1::Bloom::Kind kind :
       {v1::Bloom::KIND_MIP, v1::Bloom::KIND_CONSERVE, v1::Bloom::KIND_GAUSSIAN}) {
    for (const char* tier : {"standard", "draft"}) {
      for (const uint32_t levels : {1u, 2u, 5u, 9u}) {
        v1::Settings settings;
        settings.set_tier(tier);
        settings.mutable_bloom()->set_kind(kind);
        settings.mutable_bloom()->set_levels(levels);
        if (kind == v1::Bloom::KIND_GAUSSIAN) settings.mutable_bloom()->set_threshold(8);
        const std::string what = std::string(tier) + ", " + std::to_string(levels) + " levels of kind " +
                                 std::to_string(static_cast<int>(kind));
        expect_same(lights(1500, 1100, {{700, 500}}, 3, white), settings, kind != v1::Bloom::KIND_CONSERVE,
                    what);
      }
    }
  }
}

TEST_F(SparseBloom, IsTheDenseOneWhereverTheLightsAre) {
  std::mt19937 random(11);
  constexpr std::pair<uint32_t, uint32_t> kSizes[] = {{1920, 1080}, {1283, 719}, {130, 2000}, {2051, 67}};
  for (const auto& [width, height] : kSizes) {
    const std::vector<std::pair<uint32_t, uint32_t>> corners = {
        {0, 0}, {width - 1, 0}, {0, height - 1}, {width - 1, height - 1}};
    for (int round = 0; round < 8; ++round) {
      std::vector<std::pair<uint32_t, uint32_t>> at;
      if (round < 4) {
        at = {corners[static_cast<size_t>(round)]};
      } else {
        for (int i = 4; i <= round; ++i) at.emplace_back(random() % width, random() % height);
      }
      const Texel light = {4000, 4000, 4000, 1};
      expect_same(lights(width, height, at, 1 + round % 3, light), {}, true,
                  std::to_string(width) + "x" + std::to_string(height) + ", round " + std::to_string(round));
    }
  }
}

// A tile counts as dark by its brightest texel, and then no pass may find light in it. This holds at the
// threshold, if a negative component makes the luminance small, if the primaries make components negative,
// and in each format.
TEST_F(SparseBloom, IsTheDenseOneAtTheThreshold) {
  for (const float softness : {0.0f, 0.5f, 1.0f}) {
    for (const float light : {0.499f, 0.5f, 0.501f, 0.9995f, 1.0f, 1.0005f}) {
      v1::Settings settings;
      settings.mutable_bloom()->set_softness(softness);
      const WireFrame frame = lights(700, 500, {{333, 222}}, 40, {light, light, light, 1});
      EXPECT_EQ(image(render(frame, settings)->memory), dense(frame, settings)) << softness << " " << light;
    }
  }
  const std::vector<std::pair<uint32_t, uint32_t>> at = {{333, 222}};
  expect_same(lights(700, 500, at, 9, {-300, -50, 900, 1}), {}, true, "negative components");
  expect_same(lights(700, 500, at, 9, {-300, -50, 900, 1}, v1::PIXEL_FORMAT_RGBA32F), {}, true, "in floats");
  expect_same(lights(700, 500, at, 9, {0, 50, 900, 1}, v1::PIXEL_FORMAT_RGB9E5), {}, true,
              "in shared exponents");
  v1::Settings wide;
  wide.set_input_primaries(v1::PRIMARIES_REC2020);
  expect_same(lights(700, 500, at, 9, {0, 30, 0, 1}), wide, true, "wide primaries");
  expect_same(lights(700, 500, at, 9, {std::numeric_limits<float>::infinity(), 0, 0, 1}), {}, true,
              "infinite");
}

}  // namespace
}  // namespace candela::testing
