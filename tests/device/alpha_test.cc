// The setting `alpha`: straight colour, over a background, ignored. docs/pipeline.md section 5.
#include <gtest/gtest.h>
#include <half.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

#include "proto/candela/v1/settings.h"
#include "server/render/frame/frame_textures.h"
#include "server/render/plan/exposure.h"
#include "shaders/reference.h"
#include "tests/support/device_fixture.h"
#include "tests/support/frame_error.h"
#include "tests/support/settings.h"
#include "tests/support/status.h"

namespace candela::testing {
namespace {

constexpr v1::Alpha kAlphas[] = {v1::ALPHA_ASSOCIATED, v1::ALPHA_STRAIGHT, v1::ALPHA_OVER, v1::ALPHA_IGNORE};
constexpr v1::Transfer kSdrTransfers[] = {v1::TRANSFER_SRGB, v1::TRANSFER_GAMMA22, v1::TRANSFER_LINEAR};

// Settings with a fixed exposure of 1 and no bloom.
v1::Settings with_alpha(v1::Alpha alpha, v1::ToneCurve curve = v1::TONE_CURVE_ACES_HILL) {
  v1::Settings settings = plain();
  settings.set_alpha(alpha);
  settings.set_curve(curve);
  return settings;
}

v1::Settings over(float red, float green, float blue) {
  v1::Settings settings = with_alpha(v1::ALPHA_OVER);
  settings.mutable_background()->set_red(red);
  settings.mutable_background()->set_green(green);
  settings.mutable_background()->set_blue(blue);
  return settings;
}

// Every alpha from below 0 to above 1 along x, tiny ones and none at all; below, light of 2^-12 to 2^9 that
// is partly an object's and partly its own.
Texel edges_and_flames(uint32_t x, uint32_t y) {
  const float light = std::exp2(static_cast<float>(y % 64) / 3.0f - 12.0f);
  float a = static_cast<float>(x % 97) / 80.0f - 0.1f;
  if (x % 97 < 4) a = std::ldexp(1.0f, -24 + 4 * static_cast<int>(x % 97));
  if (x % 97 < 8 && x % 97 >= 4) a = 0.0f;
  const float covered = std::clamp(a, 0.0f, 1.0f) * light;
  const float own = y % 3 == 0 ? 0.0f : light * noise(x, y, 1);
  return {covered + own, 0.6f * covered + own * noise(x, y, 2), 0.2f * covered + 0.3f * own, a};
}

struct Image8 {
  uint32_t width = 0;
  std::vector<std::byte> bytes;
  int at(uint32_t x, uint32_t y, uint32_t k) const {
    return std::to_integer<int>(bytes[(size_t{y} * width + x) * 4 + k]);
  }
};

class StraightAlpha : public FrameErrorTest {
 protected:
  static Rendered must(const WireFrame& frame, const v1::Settings& settings, Verify verify = Verify::kNo) {
    auto rendered = render(frame, settings, {}, verify);
    if (!rendered.ok()) throw std::runtime_error(rendered.status().ToString());
    return *std::move(rendered);
  }
  static Image8 picture(const WireFrame& frame, const v1::Settings& settings) {
    return {frame.desc.width, image(must(frame, settings).memory)};
  }
  // The display values before quantising.
  static std::vector<std::array<float, 4>> values(const WireFrame& frame, const v1::Settings& settings) {
    const Rendered rendered = must(frame, settings, Verify::kYes);
    const FrameTextures& textures = rendered.memory.textures();
    std::vector<std::array<float, 4>> all(size_t{frame.desc.width} * frame.desc.height);
    for (size_t i = 0; i < all.size(); ++i) {
      const size_t at = i / frame.desc.width * textures.layout.pitch + i % frame.desc.width;
      std::memcpy(all[i].data(), textures.host_exact().mapped() + at * sizeof all[i], sizeof all[i]);
    }
    return all;
  }
};

// The error of the composited pixel has the colour's and alpha's.
constexpr double kMaxCodes = 1e-3;
constexpr double kMaxP999 = 5e-4;

WireFrame mixed(uint32_t width, uint32_t height, v1::PixelFormat format = v1::PIXEL_FORMAT_RGBA16F) {
  return make_frame(width, height, format, edges_and_flames);
}

TEST_F(StraightAlpha, IsWithinItsBoundForEveryCurveTransferAndFormat) {
  print_header("straight alpha: curve, transfer, format");
  for (v1::ToneCurve curve : kCurves) {
    for (v1::Transfer transfer : kSdrTransfers) {
      for (v1::PixelFormat format : {v1::PIXEL_FORMAT_RGBA16F, v1::PIXEL_FORMAT_RGBA32F}) {
        v1::Settings settings = with_alpha(v1::ALPHA_STRAIGHT, curve);
        settings.set_transfer(transfer);
        check(mixed(131, 67, format), settings,
              v1::word_of(curve) + " " + v1::word_of(transfer) + " " + v1::word_of(format),
              curve == v1::TONE_CURVE_ACES_2   ? Bounds{.max = 0.03, .p999 = 2e-3}
              : curve == v1::TONE_CURVE_BT2390 ? Bounds{.max = 0.012, .p999 = 0.01}
                                               : Bounds{.max = kMaxCodes, .p999 = kMaxP999});
      }
    }
  }
}

TEST_F(StraightAlpha, IsWithinItsBoundForEveryAlphaBloomAndOutput) {
  for (v1::Alpha alpha : kAlphas) {
    for (v1::Bloom::Kind kind : {v1::Bloom::KIND_MIP, v1::Bloom::KIND_CONSERVE, v1::Bloom::KIND_GAUSSIAN}) {
      for (v1::OutputFormat output :
           {v1::OUTPUT_FORMAT_RGBA8, v1::OUTPUT_FORMAT_RGBA16, v1::OUTPUT_FORMAT_RGBA16F}) {
        v1::Settings settings;
        settings.set_alpha(alpha);
        settings.set_output_format(output);
        settings.mutable_bloom()->set_kind(kind);
        settings.mutable_bloom()->set_intensity(0.3f);
        settings.mutable_background()->set_green(0.7f);
        const Rendered rendered = must(mixed(131, 67), settings, Verify::kYes);
        const Verification& error = rendered.report.verification->rounded;
        const std::string what = v1::word_of(alpha) + " " + v1::word_of(kind) + " " + v1::word_of(output);
        EXPECT_LE(error.max_codes, kMaxCodes) << what << " at " << error.worst_x << ", " << error.worst_y;
        EXPECT_LE(error.p999_codes, kMaxP999) << what;
        EXPECT_LE(error.meter_error_ev, 2e-5) << what;
      }
    }
  }
}

TEST_F(StraightAlpha, ARealViewAndAcesAreWithinTheirBounds) {
  v1::Settings settings = with_alpha(v1::ALPHA_STRAIGHT, v1::TONE_CURVE_ACES_1);
  const Rendered rendered = must(mixed(131, 67), settings, Verify::kYes);
  EXPECT_LE(rendered.report.verification->rounded.max_codes,
            2.0);  // of the table, on the object and its light
  EXPECT_LE(rendered.report.verification->rounded.mean_codes, 0.1);
}

TEST_F(StraightAlpha, ASoftEdgeKeepsItsColourAllAlong) {
  // Products with powers of two are exact halves.
  const auto edge = [](float colour) {
    return make_frame(257, 1, v1::PIXEL_FORMAT_RGBA16F, [=](uint32_t x, uint32_t) -> Texel {
      const float a = static_cast<float>(x) / 256.0f;
      return {colour * a, 0.5f * colour * a, 0.25f * colour * a, a};
    });
  };
  for (v1::ToneCurve curve : kCurves) {
    for (const float colour : {0.25f, 1.0f, 8.0f}) {
      const Image8 seen = picture(edge(colour), with_alpha(v1::ALPHA_STRAIGHT, curve));
      EXPECT_EQ(seen.at(0, 0, 0) + seen.at(0, 0, 1) + seen.at(0, 0, 2) + seen.at(0, 0, 3), 0);
      for (uint32_t x = 1; x <= 256; ++x) {
        for (uint32_t k = 0; k < 3; ++k) {
          EXPECT_NEAR(seen.at(x, 0, k), seen.at(256, 0, k), colour == 8.0f ? 1 : 0) << x << " " << k;
        }
        EXPECT_EQ(seen.at(x, 0, 3), std::lround(255.0 * x / 256)) << x;
      }
    }
  }
}

TEST_F(StraightAlpha, LightWithoutAlphaIsShownAndGetsTheAlphaThatShowsIt) {
  const auto flame = [](float alpha) {
    return make_frame(33, 65, v1::PIXEL_FORMAT_RGBA16F, [=](uint32_t x, uint32_t y) -> Texel {
      const float light = std::exp2(static_cast<float>(y) / 4.0f - 10.0f);
      return {light, 0.4f * light, 0.03f * static_cast<float>(x) * light, alpha};
    });
  };
  for (v1::ToneCurve curve : kCurves) {
    const auto opaque = values(flame(1), with_alpha(v1::ALPHA_STRAIGHT, curve));
    for (const float alpha :
         {0.0f, -1.0f, -std::numeric_limits<float>::infinity(), std::numeric_limits<float>::quiet_NaN()}) {
      const auto seen = values(flame(alpha), with_alpha(v1::ALPHA_STRAIGHT, curve));
      for (size_t i = 0; i < seen.size(); ++i) {
        EXPECT_EQ(seen[i][3], *std::max_element(opaque[i].begin(), opaque[i].begin() + 3)) << i;
        for (size_t k = 0; k < 3; ++k) EXPECT_NEAR(seen[i][k] * seen[i][3], opaque[i][k], 1e-6) << i;
      }
    }
  }
}

// Along all alphas, for an object and a flame of each brightness, the composited picture never jumps, and no
// pixel is darker than both the object and the flame.
TEST_F(StraightAlpha, NothingJumpsAndNothingIsDarker) {
  constexpr uint32_t kSteps = 2048;
  const WireFrame frame =
      make_frame(kSteps + 1, 8, v1::PIXEL_FORMAT_RGBA32F, [](uint32_t x, uint32_t y) -> Texel {
        const float a = static_cast<float>(x) / kSteps;
        const float object = y % 2 == 0 ? 0.5f : 4.0f;
        const float own = std::exp2(static_cast<float>(y) - 5.0f);
        const float light = a * object + (1 - a) * own;
        return {light, light, light, a};
      });
  for (v1::ToneCurve curve : kCurves) {
    v1::Settings settings = with_alpha(v1::ALPHA_STRAIGHT, curve);
    settings.set_output_format(v1::OUTPUT_FORMAT_RGBA16F);  // display-linear: no steep transfer
    const auto seen = values(frame, settings);
    const auto opaque = values(make_frame(2, 1, v1::PIXEL_FORMAT_RGBA32F,
                                          [](uint32_t x, uint32_t) -> Texel {
                                            const float object = x == 0 ? 0.5f : 4.0f;
                                            return {object, object, object, 1};
                                          }),
                               settings);
    for (uint32_t y = 0; y < 8; ++y) {
      for (uint32_t x = 1; x <= kSteps; ++x) {
        const auto& p = seen[size_t{y} * (kSteps + 1) + x];
        const auto& before = seen[size_t{y} * (kSteps + 1) + x - 1];
        EXPECT_LE(std::abs(p[0] * p[3] - before[0] * before[3]), 0.02) << v1::word_of(curve) << x << " " << y;
        EXPECT_LE(std::abs(p[3] - before[3]), 0.02) << v1::word_of(curve) << x << " " << y;
        EXPECT_GE(p[0], opaque[y % 2][0] - 1e-3) << v1::word_of(curve) << " " << x << " " << y;
      }
    }
  }
}

TEST_F(StraightAlpha, AlphaAboveOneAndInfinityAreOpaque) {
  const auto with = [](float alpha) {
    return make_frame(67, 35, v1::PIXEL_FORMAT_RGBA32F, [=](uint32_t x, uint32_t y) {
      Texel c = scenes::natural(67, 35)(x, y);
      c[3] = alpha;
      return c;
    });
  };
  for (v1::Alpha alpha : {v1::ALPHA_STRAIGHT, v1::ALPHA_OVER, v1::ALPHA_IGNORE}) {
    v1::Settings settings = with_alpha(alpha);
    settings.mutable_background()->set_red(3);
    const auto opaque = image(must(with(1.0f), settings).memory);
    for (const float a : {1.5f, 1e30f, std::numeric_limits<float>::infinity()}) {
      EXPECT_EQ(image(must(with(a), settings).memory), opaque) << a << " " << v1::word_of(alpha);
    }
  }
}

// An opaque frame has no bit and no step of its own, whatever the setting.
TEST_F(StraightAlpha, AnOpaqueFrameIsRenderedAsWithoutAlpha) {
  for (const auto format : {v1::PIXEL_FORMAT_RGBA16F, v1::PIXEL_FORMAT_RGBA32F, v1::PIXEL_FORMAT_RGB9E5}) {
    for (const uint32_t width : {64u, 131u}) {
      const WireFrame frame = make_frame(width, 67, format, [=](uint32_t x, uint32_t y) {
        Texel c = scenes::natural(width, 67)(x, y);
        c[3] = 1;
        return c;
      });
      v1::Settings settings;
      settings.mutable_background()->set_red(3);
      const Rendered associated = must(frame, settings);
      for (v1::Alpha alpha : kAlphas) {
        settings.set_alpha(alpha);
        const Rendered seen = must(frame, settings);
        EXPECT_EQ(image(seen.memory), image(associated.memory));
        EXPECT_EQ(seen.report.plan.words, associated.report.plan.words);
        EXPECT_EQ(seen.report.plan.resolve.inputs.constants.alpha, shader::ALPHA_ASSOCIATED);
        EXPECT_EQ(seen.report.stats.mean_log2_luminance, associated.report.stats.mean_log2_luminance);
        EXPECT_EQ(seen.report.stats.absent_pixels, 0u);
      }
      for (const std::string& line : associated.report.plan.words) {
        EXPECT_FALSE(says(line, "alpha"));
      }
    }
  }
}

TEST_F(StraightAlpha, OneOtherAlphaAnywhereIsSeen) {
  for (const auto format : {v1::PIXEL_FORMAT_RGBA16F, v1::PIXEL_FORMAT_RGBA32F}) {
    for (const float other : {0.0f, -0.0f, -1.0f, -2.0f, 0.99951171875f, 1.0009765625f, 2.0f, 6e-8f}) {
      for (const auto& [px, py] : {std::pair{0u, 0u}, {130u, 66u}, {65u, 33u}}) {
        const WireFrame frame =
            make_frame(131, 67, format, [=, px = px, py = py](uint32_t x, uint32_t y) -> Texel {
              return {0.5f, 0.5f, 0.5f, x == px && y == py ? other : 1.0f};
            });
        const Rendered seen = must(frame, with_alpha(v1::ALPHA_STRAIGHT));
        EXPECT_EQ(seen.report.plan.resolve.inputs.constants.alpha, shader::ALPHA_STRAIGHT) << other;
      }
    }
  }
}

// The opaque pixels of a frame have the same bits beside transparent ones.
TEST_F(StraightAlpha, OpaquePixelsBesideTransparentOnesKeepTheirBits) {
  const auto frame = [](float alpha) {
    return make_frame(131, 67, v1::PIXEL_FORMAT_RGBA16F, [=](uint32_t x, uint32_t y) {
      Texel c = scenes::natural(131, 67)(x, y);
      c[3] = (x + y) % 2 == 0 ? alpha : 1;
      return c;
    });
  };
  for (v1::ToneCurve curve : kCurves) {
    for (v1::Transfer transfer : kSdrTransfers) {
      v1::Settings settings = with_alpha(v1::ALPHA_STRAIGHT, curve);
      settings.set_transfer(transfer);
      const auto opaque = values(frame(1), settings);
      const auto seen = values(frame(0.25f), settings);
      for (size_t i = 0; i < seen.size(); ++i) {
        if ((i % 131 + i / 131) % 2 == 0) continue;
        EXPECT_EQ(seen[i], opaque[i]) << v1::word_of(curve) << " " << i;
      }
    }
  }
}

TEST_F(StraightAlpha, OverIsTheCompositedScene) {
  const WireFrame half_there = flat(67, 35, {0.25f, 0.5f, 0.125f, 0.5f});
  const Rendered seen = must(half_there, over(0.5f, 0.25f, 2.0f));
  EXPECT_EQ(image(seen.memory),
            image(must(flat(67, 35, {0.5f, 0.625f, 1.125f, 1.0f}), with_alpha(v1::ALPHA_OVER)).memory));
  // Metering does not see the background.
  v1::Settings metered = over(0.5f, 0.25f, 2.0f);
  metered.mutable_exposure()->set_mode(v1::Exposure::MODE_AUTO);
  EXPECT_EQ(must(half_there, metered).report.stats.mean_log2_luminance,
            must(half_there, {}).report.stats.mean_log2_luminance);
}

TEST_F(StraightAlpha, IgnoreTakesEveryPixelAsOpaque) {
  const auto frame = [](bool opaque) {
    return make_frame(131, 67, v1::PIXEL_FORMAT_RGBA16F, [=](uint32_t x, uint32_t y) {
      Texel c = edges_and_flames(x, y);
      if (x % 5 == 0) c = {0, 0, 0, 0};
      if (opaque) c[3] = 1;
      return c;
    });
  };
  v1::Settings settings;
  settings.set_alpha(v1::ALPHA_IGNORE);
  const Rendered seen = must(frame(false), settings), opaque = must(frame(true), settings);
  EXPECT_EQ(image(seen.memory), image(opaque.memory));
  EXPECT_EQ(seen.report.exposure, opaque.report.exposure);
  EXPECT_EQ(seen.report.stats.absent_pixels, 0u);
}

TEST_F(StraightAlpha, BloomAroundAnObjectGetsAlpha) {
  const WireFrame frame = make_frame(64, 64, v1::PIXEL_FORMAT_RGBA16F, [](uint32_t x, uint32_t y) -> Texel {
    const bool lamp = x >= 28 && x < 36 && y >= 28 && y < 36;
    return lamp ? Texel{50, 40, 30, 1} : Texel{0, 0, 0, 0};
  });
  v1::Settings settings = with_alpha(v1::ALPHA_STRAIGHT);
  settings.mutable_bloom()->set_intensity(0.2f);
  const Image8 seen = picture(frame, settings);
  EXPECT_EQ(seen.at(32, 32, 3), 255);
  EXPECT_GT(seen.at(24, 32, 3), 20);
  EXPECT_LT(seen.at(24, 32, 3), 255);
  EXPECT_GE(seen.at(24, 32, 0), 250);  // the colour is the glow's, at full strength
}

// Absent pixels, with alpha 0 and no light, are not metered: docs/pipeline.md sections 1 and 2.

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
