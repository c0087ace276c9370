// Properties that hold for every frame, whatever it contains.
#include <gtest/gtest.h>
#include <half.h>

#include <algorithm>
#include <cmath>
#include <cstring>

#include "proto/candela/v1/settings.h"
#include "server/render/frame/frame_textures.h"
#include "shaders/reference.h"
#include "tests/device/properties_fixture.h"
#include "tests/support/device_fixture.h"
#include "tests/support/settings.h"
#include "tests/support/status.h"

namespace candela::testing {
namespace {

// A uniform frame's mean is the logarithm of its value, however many texels are summed. So this test notices
// a texel that is lost, counted twice or read from the padding, and a sum that overflows.
TEST_F(Properties, MeterCountsEveryTexelOnceAtEverySize) {
  for (uint32_t height = 1; height <= 67; ++height) {
    for (uint32_t width = 1; width <= 67; ++width) {
      // Texel (0, 0) differs, so that its weight is also checked.
      const auto texel = [](uint32_t x, uint32_t y) -> Texel {
        const float v = x == 0 && y == 0 ? 1024.0f : 0.25f;
        return {v, v, v, 1};
      };
      const Rendered r = must_render(make_frame(width, height, v1::PIXEL_FORMAT_RGBA16F, texel));
      const double mean = -2.0 + 12.0 / (width * height);
      ASSERT_NEAR(r.report.stats.mean_log2_luminance, mean, 2e-5) << width << "x" << height;
      ASSERT_FLOAT_EQ(r.report.stats.min_luminance, width * height == 1 ? 1024.0f : 0.25f);
      ASSERT_FLOAT_EQ(r.report.stats.max_luminance, 1024.0f);
    }
  }
}

TEST_F(Properties, MeterDoesNotOverflowOnLargeUniformFrames) {
  for (float v : {0.0f, 0.18f, 65504.0f}) {
    const Rendered r = must_render(flat(1920, 1080, {v, v, v, 1}));
    // The wire carries halves. Black is metered at the floor.
    const double half = imath_half_to_float(imath_float_to_half(v));
    EXPECT_NEAR(r.report.stats.mean_log2_luminance, std::log2(std::max(half, 1e-4)), 2e-5) << v;
  }
}

TEST_F(Properties, MeterSeesTheLastColumnsAndRows) {
  // floor(W / 8) tiles would miss these.
  const WireFrame frame =
      make_frame(1921, 1081, v1::PIXEL_FORMAT_RGBA16F, [](uint32_t x, uint32_t y) -> Texel {
        const float v = x == 1920 || y == 1080 ? 8.0f : 0.125f;
        return {v, v, v, 1};
      });
  const double edge = 1921.0 + 1081.0 - 1.0;
  const double expected = -3.0 + 6.0 * edge / (1921.0 * 1081.0);
  EXPECT_NEAR(must_render(frame).report.stats.mean_log2_luminance, expected, 2e-5);
}

TEST_F(Properties, FlatFieldStaysFlatAtEverySizeForEveryKindOfBloom) {
  v1::Settings settings;
  settings.mutable_bloom()->set_intensity(0.5f);
  settings.set_output_format(v1::OUTPUT_FORMAT_RGBA16);
  for (v1::Bloom::Kind kind : {v1::Bloom::KIND_MIP, v1::Bloom::KIND_CONSERVE, v1::Bloom::KIND_GAUSSIAN}) {
    settings.mutable_bloom()->set_kind(kind);
    if (kind == v1::Bloom::KIND_GAUSSIAN)
      settings.mutable_bloom()->set_threshold(0.5f);  // of the mean, so that all of it blooms
    for (uint32_t height = 1; height <= 67; ++height) {
      for (uint32_t width = 1; width <= 67; ++width) {
        const Rendered r = must_render(flat(width, height, {3, 2, 1.5f, 1}), settings);
        ASSERT_TRUE(r.report.plan.bloom());
        const auto first = r.memory.output_row(0);
        for (uint32_t y = 0; y < height; ++y) {
          const auto row = r.memory.output_row(y);
          for (uint32_t x = 0; x < width; ++x) {
            for (size_t k = 0; k < 3; ++k) {
              uint16_t a;
              uint16_t b;
              std::memcpy(&a, &first[2 * k], 2);
              std::memcpy(&b, &row[8 * x + 2 * k], 2);
              ASSERT_LE(std::abs(a - b), 1) << width << "x" << height << " at " << x << ", " << y;
            }
          }
        }
      }
    }
  }
}

// Conserving bloom moves light without adding any, so a flat field keeps its value.
TEST_F(Properties, ConservingBloomKeepsAFlatFieldsValue) {
  v1::Settings settings;
  settings.set_curve(v1::TONE_CURVE_LINEAR);
  settings.mutable_exposure()->set_mode(v1::Exposure::MODE_MANUAL);
  settings.set_output_format(v1::OUTPUT_FORMAT_RGBA16F);
  settings.mutable_bloom()->set_kind(v1::Bloom::KIND_CONSERVE);
  settings.mutable_bloom()->set_intensity(0.75f);
  const Rendered r = must_render(flat(67, 41, {0.25f, 0.5f, 0.75f, 1}), settings);
  const auto texel = r.memory.output_row(20).subspan(8 * 30, 8);
  for (size_t k = 0; k < 3; ++k) {
    uint16_t bits;
    std::memcpy(&bits, &texel[2 * k], 2);
    EXPECT_EQ(imath_half_to_float(bits), 0.25f * static_cast<float>(k + 1)) << k;
  }
}

TEST_F(Properties, DitherIsZeroOnAverageWithinACodeAndChangesWithTheFrame) {
  v1::Settings settings = plain();
  settings.set_curve(v1::TONE_CURVE_LINEAR);
  settings.set_transfer(v1::TRANSFER_LINEAR);
  const float value = 100.25f / 255.0f;  // between two codes: a quarter of the way
  const WireFrame frame = flat(512, 512, {value, value, value, 1}, v1::PIXEL_FORMAT_RGBA32F);
  const double exact = imath_half_to_float(imath_float_to_half(value)) * 255.0;
  settings.set_dither(true);
  std::vector<std::byte> images[2];
  for (uint64_t sequence : {0u, 1u}) {
    ASSERT_OK_AND_ASSIGN(auto rendered, render(frame, settings, {sequence, std::nullopt}));
    std::vector<std::byte>& bytes = images[sequence];
    bytes = image(rendered.memory);
    double sum = 0.0;
    double squares = 0.0;
    for (size_t i = 0; i < bytes.size(); i += 4) {
      for (size_t k = 0; k < 3; ++k) {
        const double off = std::to_integer<int>(bytes[i + k]) - exact;
        ASSERT_LT(std::abs(off), 1.5) << i;
        sum += off;
        squares += off * off;
      }
      ASSERT_EQ(bytes[i + 3], std::byte{255});
    }
    const double count = 512.0 * 512.0 * 3.0;
    EXPECT_NEAR(sum / count, 0.0, 0.003);
    // The triangle's variance of 1/6 plus the rounding's 1/12. It does not depend on the fraction of a code.
    EXPECT_NEAR(squares / count, 0.25, 0.005);
  }
  EXPECT_NE(images[0], images[1]);
  EXPECT_EQ(images[0], image(render(frame, settings)->memory));
}

// Measures how much the picture's light varies while a small light moves by eighths of a pixel. The number is
// stated in docs/pipeline.md.
TEST_F(Properties, AMovingHighlightFlickersByAtMostTheStatedNumber) {
  const auto flicker = [](bool firefly) {
    double least = INFINITY;
    double most = 0.0;
    double sum = 0.0;
    for (int step = 0; step < 16; ++step) {
      const double x0 = 100.0 + step / 8.0;
      const WireFrame frame =
          make_frame(256, 256, v1::PIXEL_FORMAT_RGBA32F, [=](uint32_t x, uint32_t y) -> Texel {
            const double cover = std::clamp(std::min(x + 1.0, x0 + 1.5) - std::max<double>(x, x0), 0.0, 1.0);
            const float v = y == 101 ? static_cast<float>(1000.0 * cover) : 0.0f;
            return {v, v, v, 1};
          });
      v1::Settings settings = at_ev(-14);
      settings.set_curve(v1::TONE_CURVE_LINEAR);
      settings.set_output_format(v1::OUTPUT_FORMAT_RGBA16);
      settings.set_transfer(v1::TRANSFER_LINEAR);
      settings.mutable_bloom()->set_intensity(1);
      settings.mutable_bloom()->set_firefly_weights(firefly);
      auto rendered = render(frame, settings);
      if (!rendered.ok()) throw std::runtime_error(rendered.status().ToString());
      const double n = static_cast<double>(rendered->memory.textures().levels.size());
      const FrameTextures& textures = rendered->memory.textures();
      const LevelView level(textures, textures.layout.level_sizes[0], textures.levels[0].buffer());
      double light = 0.0;
      for (size_t i = 0; i < 128 * 128; ++i) light += level.at(i % 128, i / 128)[0] * 4.0 / n;
      least = std::min(least, light);
      most = std::max(most, light);
      sum += light;
    }
    return (most - least) / (sum / 16);
  };
  if (!device().unified_memory()) GTEST_SKIP() << "levels cannot be read back without unified memory";
  const double plain = flicker(false);
  const double weighted = flicker(true);
  std::printf("bloom flicker of a 1.5-pixel light: %.4f plain, %.4f with firefly weights\n", plain, weighted);
  EXPECT_LE(plain, 0.01);
  EXPECT_LE(weighted, 1.5);
}

TEST_F(Properties, SameInputGivesTheSameBits) {
  const WireFrame frame = natural(641, 479);
  const Rendered first = must_render(frame);
  for (int run = 0; run < 5; ++run) {
    const Rendered again = must_render(frame);
    EXPECT_EQ(image(first.memory), image(again.memory));
    EXPECT_EQ(first.report.stats.mean_log2_luminance, again.report.stats.mean_log2_luminance);
  }
}

TEST_F(Properties, SkippingBloomWhereNothingIsBrightChangesNoBit) {
  // Everything is below the threshold and its knee, so the dense run adds zeros. Only the last
  // texel may bloom.
  const auto scene = [](float last) {
    return make_frame(333, 257, v1::PIXEL_FORMAT_RGBA16F, [=](uint32_t x, uint32_t y) -> Texel {
      const float v = x == 332 && y == 256 ? last : 0.4f * noise(x, y, 0);
      return {v, v, 0.5f * v, 1};
    });
  };
  v1::Settings with;
  with.mutable_exposure()->set_mode(v1::Exposure::MODE_MANUAL);
  v1::Settings without = with;
  without.mutable_bloom()->set_intensity(0);
  const Rendered skipped = must_render(scene(0.1f), with);
  EXPECT_FALSE(skipped.report.plan.bloom());
  EXPECT_EQ(image(skipped.memory), image(must_render(scene(0.1f), without).memory));
  EXPECT_TRUE(must_render(scene(30.0f), with).report.plan.bloom());
}

TEST_F(Properties, AlphaPassesThroughInEveryFormat) {
  for (v1::PixelFormat in : {v1::PIXEL_FORMAT_RGBA16F, v1::PIXEL_FORMAT_RGBA32F, v1::PIXEL_FORMAT_RGB9E5}) {
    for (v1::OutputFormat out :
         {v1::OUTPUT_FORMAT_RGBA8, v1::OUTPUT_FORMAT_RGBA16, v1::OUTPUT_FORMAT_RGBA16F}) {
      // Halves, two of which the unorm formats clamp.
      const auto alpha = [](uint32_t x) {
        return x == 256 ? 2.0f : x == 255 ? -1.0f : static_cast<float>(x) / 256;
      };
      const WireFrame frame = make_frame(257, 3, in, [&](uint32_t x, uint32_t) -> Texel {
        return {100, 0, 1, alpha(x)};
      });
      v1::Settings settings;
      settings.set_output_format(out);
      const Rendered r = must_render(frame, settings);
      for (uint32_t x = 0; x < 257; ++x) {
        const float expected = in == v1::PIXEL_FORMAT_RGB9E5 ? 1.0f : alpha(x);
        const std::byte* texel = &r.memory.output_row(1)[x * bytes_per_pixel(out)];
        uint16_t word;
        std::memcpy(&word, texel + 6 % (bytes_per_pixel(out) - 1), 2);
        if (out == v1::OUTPUT_FORMAT_RGBA8) {
          EXPECT_EQ(std::to_integer<int>(texel[3]), std::lround(255 * std::clamp(expected, 0.0f, 1.0f))) << x;
        } else if (out == v1::OUTPUT_FORMAT_RGBA16) {
          EXPECT_EQ(word, std::lround(65535 * std::clamp(expected, 0.0f, 1.0f))) << x;
        } else {
          EXPECT_EQ(imath_half_to_float(word), expected) << x;
        }
      }
    }
  }
}

TEST_F(Properties, PrescaleIsExposureByAnotherName) {
  const WireFrame frame = natural(67, 35);
  v1::Settings prescaled;
  prescaled.mutable_exposure()->set_mode(v1::Exposure::MODE_MANUAL);
  prescaled.set_prescale(2);
  v1::Settings exposed = at_ev(1);
  EXPECT_EQ(image(must_render(frame, prescaled).memory), image(must_render(frame, exposed).memory));
}

// The image is larger than some devices can bind at once.
TEST_F(Properties, AnImageOfMoreThan128MiBIsWhole) {
  constexpr uint32_t kFrameWidth = 8192, kFrameHeight = 2200;
  const WireFrame tile = natural(kFrameWidth, 64, v1::PIXEL_FORMAT_RGB9E5);
  WireFrame frame = {{kFrameWidth, kFrameHeight, v1::PIXEL_FORMAT_RGB9E5}, {}};
  for (uint32_t y = 0; y < kFrameHeight; ++y) {
    const auto row = tile.pixels.begin() + static_cast<std::ptrdiff_t>(y % 64 * tile.desc.row_bytes());
    frame.pixels.insert(frame.pixels.end(), row, row + static_cast<std::ptrdiff_t>(tile.desc.row_bytes()));
  }
  v1::Settings settings = plain();
  settings.set_output_format(v1::OUTPUT_FORMAT_RGBA16);
  const Rendered small = must_render(tile, settings);
  const Rendered large = must_render(frame, settings);
  for (uint32_t y = 0; y < kFrameHeight; ++y) {
    const std::span<const std::byte> is = large.memory.output_row(y),
                                     should = small.memory.output_row(y % 64);
    ASSERT_TRUE(std::equal(is.begin(), is.end(), should.begin(), should.end())) << "row " << y;
  }
}

TEST_F(Properties, EveryPassOfThePlanIsTimed) {
  const FrameReport report = must_render(natural(640, 480)).report;
  if (device().timestamp_mask() == 0) GTEST_SKIP() << "this device has no timestamps";
  std::vector<Pass> passes = {Pass::kIngest, Pass::kResolve};
  for (const BloomStep& step : report.plan.bloom_steps) passes.push_back(step.pass);
  for (const Pass pass : passes) {
    const auto same = std::find_if(report.stages.begin(), report.stages.end(), [&](const StageTime& stage) {
      return std::strcmp(stage.name, name(pass)) == 0;
    });
    ASSERT_NE(same, report.stages.end()) << name(pass);
    EXPECT_GT(same->ns, 0u) << name(pass);
  }
}

TEST_F(Properties, StagingCopiesChangeNoBit) {
  ASSERT_OK_AND_ASSIGN(auto staged, Device::create({.selector = "", .validation = false, .staging = true}));
  EXPECT_FALSE(staged->unified_memory());
  TexturePool own_pool(*staged, uint64_t{1} << 30, real_clock());
  ASSERT_OK_AND_ASSIGN(auto own, Renderer::create(*staged, own_pool));
  EXPECT_EQ(own->executor_kind(), ExecutorKind::kDevice);
  for (const WireFrame& frame :
       {natural(131, 67), natural(64, 64, v1::PIXEL_FORMAT_RGBA32F), flat(3, 5, {NAN, 1, 2, 1})}) {
    for (int run = 0; run < 2; ++run) {
      ASSERT_OK_AND_ASSIGN(auto there, render_on(*own, frame, {}));
      ASSERT_OK_AND_ASSIGN(auto here, render_on(renderer_with(ExecutorKind::kDevice), frame, {}));
      EXPECT_EQ(image(there.memory), image(here.memory));
      EXPECT_EQ(there.report.exposure, here.report.exposure);
      EXPECT_EQ(there.report.stats.nan_components, here.report.stats.nan_components);
    }
  }
}

TEST_F(Properties, LinearHalfOutputIsTheSceneItself) {
  v1::Settings settings = plain();
  settings.set_curve(v1::TONE_CURVE_LINEAR);
  settings.set_output_format(v1::OUTPUT_FORMAT_RGBA16F);
  // Every half in [0, 1], including subnormal ones, must come back unchanged, because ingest is exact.
  const uint32_t count = 0x3c00 + 1;
  WireFrame frame{{count, 1, v1::PIXEL_FORMAT_RGBA16F}, {}};
  frame.pixels.resize(frame.desc.bytes());
  for (uint32_t i = 0; i < count; ++i) {
    const std::array<uint16_t, 4> texel = {static_cast<uint16_t>(i), static_cast<uint16_t>(i),
                                           static_cast<uint16_t>(i), static_cast<uint16_t>(i)};
    std::memcpy(&frame.pixels[size_t{i} * 8], texel.data(), 8);
  }
  EXPECT_EQ(image(must_render(frame, settings).memory), frame.pixels);
}

TEST_F(Properties, Frame8KPasses) {
  const WireFrame frame = flat(7680, 4320, {0.18f, 0.18f, 0.18f, 1});
  v1::Settings settings;
  settings.mutable_bloom()->set_threshold(0.01f);  // all of it is bright
  const Rendered r = must_render(frame, settings);
  EXPECT_TRUE(r.report.plan.bloom());
  EXPECT_NEAR(r.report.stats.mean_log2_luminance, std::log2(imath_half_to_float(imath_float_to_half(0.18f))),
              2e-5);
  const uint8_t code = std::to_integer<uint8_t>(r.memory.output_row(0)[0]);
  for (uint32_t y = 0; y < 4320; y += 7) {
    const auto row = r.memory.output_row(y);
    for (uint32_t x = 0; x < 7680; ++x)
      ASSERT_EQ(std::to_integer<uint8_t>(row[4 * x]), code) << x << ", " << y;
  }
}

// Each shader against its float64 twin, texture by texture.

class Stages : public DeviceTest {
 protected:
  void SetUp() override {
    DeviceTest::SetUp();
    if (!device().unified_memory()) GTEST_SKIP() << "levels cannot be read back without unified memory";
  }

  static void expect_level(const FrameMemory& memory, size_t level, const reference::Level& truth,
                           const std::string& what) {
    const LevelSize& size = memory.textures().layout.level_sizes[level];
    ASSERT_EQ(size.width, truth.width) << what;
    ASSERT_EQ(size.height, truth.height) << what;
    double maximum = 0.0;
    for (const reference::Rgb& c : truth.texels) maximum = std::max({maximum, c[0], c[1], c[2]});
    const LevelView drawn(memory.textures(), size, memory.textures().levels[level].buffer());
    double worst = 0.0;
    for (size_t i = 0; i < truth.texels.size(); ++i) {
      const std::array<float, 3> texel = drawn.at(i % size.width, i / size.width);
      for (size_t k = 0; k < 3; ++k) worst = std::max(worst, std::abs(texel[k] - truth.texels[i][k]));
    }
    EXPECT_LE(worst, kBloomBound * maximum) << what << " level " << level << ", maximum " << maximum;
  }
};

constexpr Size kStageSizes[] = {{1, 1},   {1, 7},   {2, 2},     {3, 5},     {8, 3},      {17, 31},
                                {64, 64}, {67, 63}, {129, 127}, {333, 517}, {1000, 501}, {1, 1000}};

// With n levels, the coarsest one still has D_{n-1}: bright_pass wrote it if n is 1, otherwise bloom_down
// did. Level 0 has B_0, which every bloom_up contributed to. So all n together check every level of every
// pass.
TEST_F(Stages, EveryBloomLevelIsItsTwins) {
  for (const Size& size : kStageSizes) {
    const WireFrame frame = natural(size.width, size.height);
    reference::BadCounts bad;
    const reference::Scene scene =
        reference::ingest(frame.pixels, frame.desc.row_bytes(), size.width, size.height,
                          shader::PIXELS_RGBA16F, std::nullopt, reference::Rounding::kHalf, &bad);
    for (bool firefly : {true, false}) {
      std::vector<reference::Level> d = {
          reference::bright_pass(scene, {.threshold = 0.02, .firefly_weights = firefly})};
      for (uint32_t levels = 1; levels <= 6; ++levels) {
        v1::Settings settings;
        *settings.mutable_bloom() = bloom(v1::Bloom::KIND_MIP, 1, 0.02f, 0.5f, levels, firefly);
        ASSERT_OK_AND_ASSIGN(auto rendered, render(frame, settings));
        const size_t count = rendered.memory.textures().levels.size();
        if (!rendered.report.plan.bloom() || count < levels) break;
        if (count > d.size()) d.push_back(reference::bloom_down(d.back()));
        const std::string what = std::to_string(size.width) + "x" + std::to_string(size.height);
        expect_level(rendered.memory, count - 1, d.back(), what);
        reference::Level b = d.back();
        for (size_t level = count - 1; level-- > 0;) {
          b = reference::bloom_up(d[level], b);
          expect_level(rendered.memory, level, b, what);
        }
      }
    }
  }
}

TEST_F(Stages, BloomOfOneBrightTexelSumsToTheStatedGain) {
  // Far from every edge, each filter keeps the sum. So each of n levels adds 4 times D_0's sum at level 0.
  const WireFrame frame = make_frame(512, 512, v1::PIXEL_FORMAT_RGBA16F, [](uint32_t x, uint32_t y) -> Texel {
    const float v = (x | 1) == 257 && (y | 1) == 257 ? 1000.0f : 0.0f;
    return {v, v, v, 1};
  });
  for (uint32_t levels = 1; levels <= 5; ++levels) {
    v1::Settings settings;
    *settings.mutable_bloom() = bloom(v1::Bloom::KIND_MIP, 1, 1, 0, levels, true);
    ASSERT_OK_AND_ASSIGN(auto rendered, render(frame, settings));
    const FrameTextures& textures = rendered.memory.textures();
    const LevelView level(textures, textures.layout.level_sizes[0], textures.levels[0].buffer());
    double sum = 0.0;
    for (size_t i = 0; i < 256 * 256; ++i) sum += level.at(i % 256, i / 256)[0];
    EXPECT_NEAR(sum / (999.0 * levels), 1.0, 1e-5) << levels << " levels";
  }
}

}  // namespace
}  // namespace candela::testing
