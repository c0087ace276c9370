// The setting `alpha`: straight colour, over a background, ignored. docs/pipeline.md section 5.
#include <gtest/gtest.h>
#include <half.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

#include "proto/candela/v1/settings.h"
#include "server/render/frame/frame_textures.h"
#include "tests/support/frame_error.h"
#include "tests/support/settings.h"
#include "tests/support/status.h"

namespace candela::testing {
namespace {

constexpr v1::Alpha kAlphas[] = {v1::ALPHA_ASSOCIATED, v1::ALPHA_STRAIGHT, v1::ALPHA_OVER, v1::ALPHA_IGNORE};
constexpr v1::Transfer kTransfers[] = {v1::TRANSFER_SRGB, v1::TRANSFER_GAMMA22, v1::TRANSFER_LINEAR};

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
    for (v1::Transfer transfer : kTransfers) {
      for (v1::PixelFormat format : {v1::PIXEL_FORMAT_RGBA16F, v1::PIXEL_FORMAT_RGBA32F}) {
        v1::Settings settings = with_alpha(v1::ALPHA_STRAIGHT, curve);
        settings.set_transfer(transfer);
        check(mixed(131, 67, format), settings,
              v1::word_of(curve) + " " + v1::word_of(transfer) + " " + v1::word_of(format),
              curve == v1::TONE_CURVE_ACES_2 ? Bounds{.max = 0.03, .p999 = 2e-3}
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
    for (v1::Transfer transfer : kTransfers) {
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

}  // namespace
}  // namespace candela::testing
