// The whole frame against the float64 reference: docs/pipeline.md section 6.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>

#include "server/render/verify.h"
#include "tests/support/device_fixture.h"

namespace candela::testing {
namespace {

struct Size {
  uint32_t width;
  uint32_t height;
};

constexpr Size kSizes[] = {{1, 1},     {1, 7},     {2, 2},     {3, 5},     {4, 4},      {5, 3},
                           {17, 31},   {64, 64},   {65, 63},   {67, 67},   {127, 129},  {200, 1},
                           {333, 517}, {641, 359}, {16384, 1}, {1, 16384}, {1280, 720}, {1919, 1081}};

class FrameError : public DeviceTest {
 protected:
  // Renders in RGBA16 to measure codes and in RGBA8 to count components, and holds both to section 6.
  static void check(const WireFrame& frame, Settings settings, const std::string& what) {
    settings.output_format = OutputFormat::kRgba16;
    auto fine = render(frame, settings);
    ASSERT_TRUE(fine.ok()) << what << ": " << fine.status();
    const ReferenceFrame truth = render_reference(frame.desc, frame.pixels, settings, fine->report.exposure);
    const Difference codes = compare(fine->memory, settings, truth);
    const double ev = std::abs(fine->report.stats.mean_log2_luminance - truth.meter.mean_log2_luminance);
    settings.output_format = OutputFormat::kRgba8;
    auto coarse = render(frame, settings);
    ASSERT_TRUE(coarse.ok()) << what << ": " << coarse.status();
    const Difference counts = compare(coarse->memory, settings, truth);

    std::printf("%-44s %9.5f %9.5f %9.6f %8.4f%% %9.2e\n", what.c_str(), codes.max_codes, codes.p999_codes,
                codes.mean_codes,
                100.0 * static_cast<double>(counts.differing) / static_cast<double>(counts.components), ev);
    EXPECT_LE(ev, 2e-5) << what;
    EXPECT_LE(codes.max_codes, 0.5) << what << " worst at " << codes.worst_x << ", " << codes.worst_y;
    EXPECT_LE(codes.p999_codes, 0.05) << what;
    EXPECT_LE(counts.max_difference, 1) << what;
    // 0.1 %, or one component of a frame too small for a percentage.
    EXPECT_LE(static_cast<double>(counts.differing),
              std::max(1.0, 1e-3 * static_cast<double>(counts.components)))
        << what;
    EXPECT_EQ(fine->report.stats.nan_components, truth.bad.nan) << what;
    EXPECT_EQ(fine->report.stats.infinite_components, truth.bad.infinite) << what;
    EXPECT_EQ(fine->report.stats.negative_components, truth.bad.negative) << what;
    EXPECT_NEAR(fine->report.stats.max_luminance, truth.meter.max_luminance, 1e-6 * truth.meter.max_luminance)
        << what;
    EXPECT_NEAR(fine->report.stats.min_luminance, truth.meter.min_luminance, 1e-6 * truth.meter.max_luminance)
        << what;
  }

  static void print_header(const char* what) {
    std::printf("%-44s %9s %9s %9s %9s %9s\n", what, "max", "p99.9", "mean", "differ", "EV");
  }
};

TEST_F(FrameError, IsWithinItsBoundAtEverySize) {
  print_header("natural scene, codes against the reference");
  for (const Size& size : kSizes) {
    check(natural(size.width, size.height), {},
          std::to_string(size.width) + "x" + std::to_string(size.height));
  }
}

TEST_F(FrameError, IsWithinItsBoundAt4K) {
  print_header("natural scene at 4K");
  check(natural(3840, 2160), {}, "3840x2160");
}

TEST_F(FrameError, IsWithinItsBoundForEveryFormatCurveAndTransfer) {
  print_header("format, curve, transfer at 333x129");
  for (PixelFormat format : {PixelFormat::kRgba16f, PixelFormat::kRgba32f, PixelFormat::kRgb9e5}) {
    for (ToneCurve curve :
         {ToneCurve::kLinear, ToneCurve::kReinhard, ToneCurve::kAcesNarkowicz, ToneCurve::kAcesHill}) {
      for (Transfer transfer : {Transfer::kSrgb, Transfer::kGamma22, Transfer::kLinear}) {
        Settings settings;
        settings.curve = curve;
        settings.transfer = transfer;
        check(natural(333, 129, format), settings,
              std::string(name(format)) + " " + name(curve) + " " + name(transfer));
      }
    }
  }
}

TEST_F(FrameError, IsWithinItsBoundForEveryBloomSetting) {
  print_header("bloom settings at 333x129");
  for (float intensity : {0.0f, 0.05f, 1.0f, 10.0f}) {
    for (float threshold : {0.0f, 0.5f, 100.0f}) {
      for (float softness : {0.0f, 1.0f}) {
        for (uint32_t levels : {1u, 2u, 16u}) {
          for (bool firefly : {false, true}) {
            Settings settings;
            settings.bloom = {intensity, threshold, softness, levels, firefly};
            char what[80];
            std::snprintf(what, sizeof what, "i %g t %g s %g levels %u firefly %d", intensity, threshold,
                          softness, levels, firefly);
            check(natural(333, 129), settings, what);
          }
        }
      }
    }
  }
}

TEST_F(FrameError, IsWithinItsBoundInEveryHardCase) {
  print_header("hard cases");
  for (const Size& size : {Size{1, 1}, Size{1, 7}, Size{3, 5}, Size{130, 67}}) {
    for (const HardCase& hard : hard_cases(size.width, size.height)) {
      for (PixelFormat format : {PixelFormat::kRgba16f, PixelFormat::kRgba32f}) {
        check(make_frame(size.width, size.height, format, hard.texel), {},
              hard.name + " " + std::to_string(size.width) + "x" + std::to_string(size.height) + " " +
                  name(format));
      }
    }
  }
}

TEST_F(FrameError, IsWithinItsBoundWithOtherPrimaries) {
  print_header("input primaries at 333x129");
  const std::pair<const char*, Chromaticities> kinds[] = {
      {"Rec.2020", {{0.708, 0.292, 0.170, 0.797, 0.131, 0.046, 0.3127, 0.3290}}},
      {"ACES AP0", {{0.7347, 0.2653, 0.0, 1.0, 0.0001, -0.0770, 0.32168, 0.33767}}},
      {"CIE XYZ", {{1, 0, 0, 1, 0, 0, 1.0 / 3, 1.0 / 3}}},
  };
  for (const auto& [label, chromaticities] : kinds) {
    for (PixelFormat format : {PixelFormat::kRgba16f, PixelFormat::kRgba32f, PixelFormat::kRgb9e5}) {
      Settings settings;
      settings.input_chromaticities = chromaticities;
      check(natural(333, 129, format), settings, std::string(label) + " " + name(format));
    }
  }
}

}  // namespace
}  // namespace candela::testing
