// Each tier renders as its numbers say, and its error against the whole pipeline is as published.
#include "server/render/settings/tiers.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>

#include "absl/strings/str_format.h"
#include "proto/candela/v1/settings.h"
#include "server/render/reference/verify.h"
#include "server/render/settings/error_bound.h"
#include "tests/support/device_fixture.h"
#include "tests/support/settings.h"
#include "tests/support/status.h"

namespace candela::testing {
namespace {

// The error of the sRGB polynomial in codes, and the error of everything else.
double transfer_bound(const Tier& tier) { return tier.transfer_terms == 6 ? 0.083 : 0.0002; }
constexpr double kRestBound = 4e-4;

class Tiers : public DeviceTest {
 protected:
  static Verification against(const WireFrame& frame, const v1::Settings& settings,
                              uint32_t bloom_level_size) {
    auto rendered = render(frame, settings, {}, Verify::kYes);
    if (!rendered.ok()) throw std::runtime_error(rendered.status().ToString());
    return verify_frame(rendered->memory, rendered->report.plan, rendered->report.stats, bloom_level_size)
        .rounded;
  }
};

TEST_F(Tiers, ShadersAreTheTwinsOfTheirNumbersAtEverySizeAndKindOfBloom) {
  for (const Tier& tier : tiers()) {
    for (v1::Bloom::Kind kind : {v1::Bloom::KIND_MIP, v1::Bloom::KIND_CONSERVE, v1::Bloom::KIND_GAUSSIAN}) {
      for (uint32_t levels : {1u, 2u, 5u}) {
        for (const auto& [width, height] : {std::pair{1u, 1u},
                                            {1u, 7u},
                                            {3u, 5u},
                                            {5u, 6u},
                                            {6u, 5u},
                                            {9u, 10u},
                                            {67u, 35u},
                                            {130u, 66u},
                                            {333u, 517u}}) {
          v1::Settings settings;
          settings.set_tier(tier.name);
          settings.mutable_bloom()->set_kind(kind);
          settings.mutable_bloom()->set_intensity(0.8f);
          settings.mutable_bloom()->set_levels(levels);
          const Verification difference = against(natural(width, height), settings, tier.bloom_level_size);
          EXPECT_LE(difference.max_codes, transfer_bound(tier) + kRestBound)
              << tier.name << " " << width << "x" << height << " bloom " << static_cast<int>(kind)
              << " levels " << levels << " at " << difference.worst_x << ", " << difference.worst_y;
        }
      }
    }
  }
}

TEST_F(Tiers, ErrorsAreNotWorseThanPublished) {
  std::printf("%-12s %-28s %9s %9s %9s\n", "tier", "codes against the reference", "max", "p99.9", "mean");
  for (const Tier& tier : tiers()) {
    v1::Settings settings;
    settings.set_tier(tier.name);
    const auto show = [&](const char* what, const WireFrame& frame, double bound) {
      const Verification d = against(frame, settings, 2);
      std::printf("%-12s %-28s %9.4f %9.4f %9.5f\n", tier.name, what, d.max_codes, d.p999_codes,
                  d.mean_codes);
      EXPECT_LE(d.max_codes, bound) << tier.name << " " << what;
    };
    // Bloom that leaves its finest level out has no bound.
    const double plain = transfer_bound(tier) + kRestBound;
    const double bloomed = tier.bloom_level_size == kWholeBloom ? plain : kNoBound;
    show("natural 641x359", natural(641, 359), bloomed);
    for (const HardCase& hard : hard_cases(131, 67)) {
      show(hard.name.c_str(), make_frame(131, 67, v1::PIXEL_FORMAT_RGBA16F, hard.texel), bloomed);
    }
    settings.mutable_bloom()->set_intensity(0);
    EXPECT_LE(plain, tier.host_reference ? plain : error_bound(tier, checked(settings), {.exposure = 1}));
    show("natural, no bloom", natural(641, 359), plain);
    for (const HardCase& hard : hard_cases(131, 67)) {
      show((hard.name + ", no bloom").c_str(), make_frame(131, 67, v1::PIXEL_FORMAT_RGBA16F, hard.texel),
           plain);
    }
  }
}

// Renders the frame with max_error_codes, and checks the image against the promise and against the bound.
class Promises : public DeviceTest {
 protected:
  // What verification itself cannot tell apart: its images are floats.
  static constexpr double kFloatCodes = 5e-5;

  static std::string keep(const WireFrame& frame, v1::Settings settings, double codes,
                          const std::string& what) {
    settings.set_max_error_codes(codes);
    const auto rendered = render(frame, settings, {}, Verify::kYes);
    EXPECT_OK(rendered) << what;
    if (!rendered.ok()) return "";
    const FrameReport& report = rendered->report;
    EXPECT_TRUE(report.error_bound) << what;
    const double bound = report.error_bound.value_or(kNoBound);
    EXPECT_LE(bound, codes) << what;
    const double error = report.verification->rounded.max_codes;
    EXPECT_LE(error, bound + kFloatCodes) << what << ": " << report.tier_reason;
    EXPECT_TRUE(says(report.tier_reason, absl::StrFormat("keeps max_error_codes %g", codes)));
    std::printf("%-40s within %-5g %-10s bound %-9.4g error %.5f\n", what.c_str(), codes, report.tier.c_str(),
                bound, error);
    return report.tier;
  }

  static WireFrame frame_of(const TexelFunction& texel, uint32_t width = 131, uint32_t height = 67) {
    return make_frame(width, height, v1::PIXEL_FORMAT_RGBA16F, texel);
  }

  // Colours from 2^-12 to 2^10, none negative.
  static Texel colours(uint32_t x, uint32_t y) {
    const auto stops = [&](uint32_t seed) {
      return std::exp2(22.0f * static_cast<float>((x * 2654435761u + y * 40503u + seed) % 9973u) / 9973.0f -
                       12.0f);
    };
    return {stops(1), stops(3571), stops(7919), 1.0f};
  }
};

TEST_F(Promises, AreKeptWhereBloomIsStrong) {
  v1::Settings settings;
  settings.mutable_bloom()->set_threshold(0.3f);
  settings.mutable_bloom()->set_intensity(2);
  EXPECT_EQ(keep(frame_of(ordinary(scenes::natural(641, 359)), 641, 359), settings, 7, "strong bloom"),
            "standard");
  for (const HardCase& hard : hard_cases(131, 67)) keep(frame_of(hard.texel), settings, 7, hard.name);
  settings = {};
  settings.mutable_exposure()->set_mode(v1::Exposure::MODE_MANUAL);
  settings.mutable_exposure()->set_manual_ev(-14);
  const auto lights = [](uint32_t x, uint32_t y) -> Texel {
    const float v = (x / 3 + y / 3) % 29 == 0 ? 20000.0f : 0.01f;
    return {v, v, v, 1.0f};
  };
  EXPECT_EQ(keep(frame_of(lights), settings, 1, "lights of 20000 at -14 EV"), "standard");
  // Light just above a high threshold, which exposure shows: what is left of it has lost most of its digits.
  settings.mutable_exposure()->set_manual_ev(2);
  settings.mutable_bloom()->set_threshold(1000);
  settings.mutable_bloom()->set_softness(0);
  settings.mutable_bloom()->set_intensity(10);
  const auto barely = [](uint32_t x, uint32_t y) -> Texel {
    if ((x / 4 + y / 4) % 2 == 0) return {0, 0, 0, 1};
    return {1000.5f, 999.5f + static_cast<float>(x % 3) * 0.5f, 1001.0f, 1};
  };
  for (const double codes : {0.0, 1.0, 10.0, 100.0})
    keep(frame_of(barely), settings, codes, "just above the threshold");
  settings = {};
  settings.mutable_bloom()->set_kind(v1::Bloom::KIND_GAUSSIAN);
  keep(frame_of(ordinary(scenes::natural(641, 359)), 641, 359), settings, 2, "gaussian");
}

// GAUSSIAN's threshold is a multiple of the metered mean, and the reference's mean is another within its
// error. The light of a square is between the two thresholds.
TEST_F(Promises, AreKeptWhereOnlyTheReferenceBlooms) {
  const auto square = [](uint32_t x, uint32_t y) -> Texel {
    if (x >= 90 && x < 106 && y >= 90 && y < 106) return {936, 936, 936, 1};
    // These are metered a bin lower by the reference; see
    // Metering.APercentileIsWithinItsErrorOfTheReferences.
    if (x < 3) return {1.7998046875f, 0.91259765625f, 1.7783203125f, 1};
    return {1.17578125f, 1.17578125f, 1.17578125f, 1};
  };
  v1::Settings settings;
  settings.mutable_bloom()->set_kind(v1::Bloom::KIND_GAUSSIAN);
  settings.mutable_bloom()->set_threshold(800);
  settings.mutable_exposure()->set_mode(v1::Exposure::MODE_MANUAL);
  settings.mutable_exposure()->set_manual_ev(-3);
  v1::Metering& metering = *settings.mutable_exposure()->mutable_metering();
  metering.set_statistic(v1::Metering::STATISTIC_PERCENTILE);
  metering.set_percentile_low(0);
  metering.set_percentile_high(1);
  for (const double codes : {0.1, 100.0}) {
    EXPECT_EQ(keep(frame_of(square, 200, 200), settings, codes, "only the reference blooms"), "reference");
  }
}

// A metered mean of light that nearly cancels.
TEST_F(Promises, AreKeptWhereMeteredLightCancels) {
  const auto cancels = [](uint32_t x, uint32_t y) -> Texel {
    if (x < 8 && y < 8) return {65504.0f, -19472.0f, 3.111328125f, 1};
    return x >= 64 && x < 96 && y >= 16 && y < 48 ? Texel{5, 5, 5, 1} : Texel{0, 0, 0, 1};
  };
  v1::Settings settings;
  settings.mutable_bloom()->set_kind(v1::Bloom::KIND_GAUSSIAN);
  settings.mutable_bloom()->set_threshold(10000);
  settings.mutable_bloom()->set_intensity(10);
  settings.mutable_exposure()->set_mode(v1::Exposure::MODE_MANUAL);
  settings.mutable_exposure()->set_manual_ev(-8);
  v1::Metering& metering = *settings.mutable_exposure()->mutable_metering();
  metering.set_weights(v1::Metering::WEIGHTS_SPOT);
  metering.mutable_spot()->set_x1(8);
  metering.mutable_spot()->set_y1(8);
  for (const double codes : {1.0, 20.0}) keep(frame_of(cancels), settings, codes, "metered light cancels");
}

TEST_F(Promises, AreKeptByEveryCurveAndTransfer) {
  std::vector<v1::ToneCurve> curves(std::begin(kCurves), std::end(kCurves));
  curves.push_back(v1::TONE_CURVE_ACES_1);
  for (const v1::ToneCurve curve : curves) {
    for (const v1::Transfer transfer : {v1::TRANSFER_SRGB, v1::TRANSFER_GAMMA22, v1::TRANSFER_LINEAR}) {
      v1::Settings settings;
      settings.set_curve(curve);
      settings.set_transfer(transfer);
      settings.mutable_bloom()->set_intensity(0);
      const std::string what = v1::word_of(curve) + std::string(" ") + v1::word_of(transfer);
      for (const double codes : {0.5, 25.0}) EXPECT_NE(keep(frame_of(colours), settings, codes, what), "");
    }
  }
}

TEST_F(Promises, AreKeptInHardFrames) {
  for (const double codes : {0.02, 1.0}) {
    for (const HardCase& hard : hard_cases(131, 67)) keep(frame_of(hard.texel), {}, codes, hard.name);
  }
}

// Components of both signs cancel in a matrix, and leave their roundings.
TEST_F(Promises, AreKeptWhereLightCancels) {
  const auto cancels = [](uint32_t x, uint32_t y) -> Texel {
    const float v = std::exp2(static_cast<float>(x % 17));
    return {v, -0.59719f / 0.35458f * v * (1.0f + static_cast<float>(y % 5) * 1e-3f), 0.0f, 1.0f};
  };
  for (const v1::ToneCurve curve : {v1::TONE_CURVE_ACES_HILL, v1::TONE_CURVE_AGX, v1::TONE_CURVE_ACES_1}) {
    v1::Settings settings;
    settings.set_curve(curve);
    for (const double codes : {1.0, 30.0}) keep(frame_of(cancels), settings, codes, "cancels");
  }
  const auto rec2020 = [](uint32_t x, uint32_t y) { return colours(x, y); };
  v1::Settings settings;
  settings.set_input_primaries(v1::PRIMARIES_REC2020);
  EXPECT_NE(keep(frame_of(rec2020), settings, 1, "Rec.2020"), "draft");
}

// With a promise the scene is not rounded to halves. Bloom's is, so there is none here.
TEST_F(Promises, AreKeptForFloatsThatAreNotHalves) {
  // Nearly grey, so that a matrix leaves nothing negative.
  const auto floats = [](uint32_t x, uint32_t y) -> Texel {
    const float v = std::exp2(static_cast<float>(x * 67 + y) / 700.0f - 8.0f);
    return {v, 0.9f * v, 0.8f * v, 1};
  };
  v1::Settings settings, matrix;
  settings.mutable_bloom()->set_intensity(0);
  matrix = settings;
  matrix.set_input_primaries(v1::PRIMARIES_P3_D65);
  for (const auto& [format, asked] :
       {std::pair(v1::PIXEL_FORMAT_RGBA32F, settings), std::pair(v1::PIXEL_FORMAT_RGBA16F, matrix),
        std::pair(v1::PIXEL_FORMAT_RGBA32F, matrix)}) {
    const WireFrame frame = make_frame(131, 67, format, floats);
    v1::Settings promised = asked;
    promised.set_max_error_codes(0.01);
    ASSERT_OK_AND_ASSIGN(const auto kept, render(frame, promised, {}, Verify::kYes));
    const FrameReport& exact = kept.report;
    ASSERT_TRUE(exact.error_bound);
    EXPECT_EQ(exact.tier, "standard");
    EXPECT_LE(exact.verification->rounded.max_codes, *exact.error_bound + kFloatCodes);
    EXPECT_LE(exact.verification->unrounded.max_codes, *exact.error_bound + kFloatCodes);
    ASSERT_OK_AND_ASSIGN(const auto rounded, render(frame, asked, {}, Verify::kYes));
    EXPECT_GT(rounded.report.verification->unrounded.max_codes, 5 * *exact.error_bound);
  }
}

// Without bloom draft is as good as it says, and is taken.
TEST_F(Promises, TakeTheCheapestTierThatKeepsThem) {
  const WireFrame dim = flat(70, 50, {0.5f, 0.3f, 0.2f, 1.0f});
  EXPECT_EQ(keep(dim, {}, 0.1, "nothing blooms"), "draft");
  EXPECT_EQ(keep(dim, {}, 0.01, "nothing blooms"), "standard");
  EXPECT_EQ(keep(dim, {}, 0, "nothing blooms"), "reference");
  EXPECT_EQ(keep(natural(130, 66), {}, 255, "no promise at all"), "draft");
}

// A promise that ends with a tier gives that tier's image.
TEST_F(Promises, ImagesAreThoseOfTheTier) {
  for (const double codes : {255.0, 0.5, 0.1}) {
    for (const WireFrame& frame : {natural(130, 66), flat(70, 50, {0.5f, 0.3f, 0.2f, 1.0f})}) {
      v1::Settings settings;  // the reference's own metering differs
      settings.mutable_exposure()->set_mode(v1::Exposure::MODE_MANUAL);
      settings.set_max_error_codes(codes);
      ASSERT_OK_AND_ASSIGN(const auto promised, render(frame, settings));
      v1::Settings named;
      *named.mutable_exposure() = settings.exposure();
      named.set_tier(promised.report.tier);
      ASSERT_OK_AND_ASSIGN(const auto same, render(frame, named));
      EXPECT_TRUE(image(promised.memory) == image(same.memory)) << promised.report.tier << " for " << codes;
      EXPECT_EQ(promised.report.exposure, same.report.exposure);
    }
  }
}

}  // namespace
}  // namespace candela::testing
