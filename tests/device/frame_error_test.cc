// The whole frame against the float64 reference: docs/pipeline.md section 6.
#include "tests/support/frame_error.h"

#include <gtest/gtest.h>

#include <cstdio>

#include "proto/candela/v1/settings.h"
#include "tests/support/settings.h"

namespace candela::testing {
namespace {

constexpr Size kFrameSizes[] = {{1, 1},     {1, 7},     {2, 2},     {3, 5},     {4, 4},      {5, 3},
                                {17, 31},   {64, 64},   {65, 63},   {67, 67},   {127, 129},  {200, 1},
                                {333, 517}, {641, 359}, {16384, 1}, {1, 16384}, {1280, 720}, {1919, 1081}};

using FrameError = FrameErrorTest;

TEST_F(FrameError, IsWithinItsBoundAtEverySize) {
  print_header("natural scene, codes against the reference");
  for (const Size& size : kFrameSizes) {
    check(natural(size.width, size.height), {},
          std::to_string(size.width) + "x" + std::to_string(size.height));
  }
}

TEST_F(FrameError, IsWithinItsBoundAt4K) {
  print_header("natural scene at 4K");
  check(natural(3840, 2160), {}, "3840x2160");
}

constexpr v1::PixelFormat kPixelFormats[] = {v1::PIXEL_FORMAT_RGBA16F, v1::PIXEL_FORMAT_RGBA32F,
                                             v1::PIXEL_FORMAT_RGB9E5};
constexpr v1::Transfer kTransfers[] = {v1::TRANSFER_SRGB, v1::TRANSFER_GAMMA22, v1::TRANSFER_LINEAR};

class CurveError : public FrameErrorTest {
 protected:
  static void check_curve(v1::PixelFormat format, v1::ToneCurve curve, v1::Transfer transfer) {
    v1::Settings settings;
    settings.set_curve(curve);
    settings.set_transfer(transfer);
    // Near black, 1/2.2 is steep enough to show the cancellation in pbr-neutral's offset.
    const bool steep = curve == v1::TONE_CURVE_PBR_NEUTRAL && transfer == v1::TRANSFER_GAMMA22;
    check(natural(333, 129, format), settings,
          v1::word_of(format) + " " + v1::word_of(curve) + " " + v1::word_of(transfer),
          steep                            ? Bounds{.max = 0.022}
          : curve == v1::TONE_CURVE_ACES_2 ? Bounds{.max = 0.03, .p999 = 2e-3}
                                           : Bounds());
  }
};

TEST_F(CurveError, IsWithinItsBoundForEveryFormatAndTransfer) {
  print_header("format, curve, transfer at 333x129");
  for (v1::PixelFormat format : kPixelFormats) {
    for (v1::ToneCurve curve : kCurves) {
      for (v1::Transfer transfer : kTransfers) check_curve(format, curve, transfer);
    }
  }
}

TEST_F(CurveError, IsWithinItsBoundForEachOfThem) {
  print_header("each format, curve and transfer at 333x129");
  for (size_t i = 0; i < std::size(kCurves); ++i) {
    check_curve(kPixelFormats[i % 3], kCurves[i], kTransfers[(i + i / 3) % 3]);
  }
}

TEST_F(FrameError, IsWithinItsBoundForEveryBloomSetting) {
  print_header("bloom settings at 333x129");
  for (float intensity : {0.0f, 0.05f, 1.0f, 10.0f}) {
    for (float threshold : {0.0f, 0.5f, 100.0f}) {
      for (float softness : {0.0f, 1.0f}) {
        for (uint32_t levels : {1u, 2u, 16u}) {
          for (bool firefly : {false, true}) {
            v1::Settings settings;
            *settings.mutable_bloom() =
                bloom(v1::Bloom::KIND_MIP, intensity, threshold, softness, levels, firefly);
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

// Every kind of bloom with every kind of metering, because the Gaussian's threshold depends on the metering.
std::vector<std::pair<std::string, v1::Settings>> bloom_and_metering() {
  std::vector<std::pair<std::string, v1::Settings>> all;
  for (v1::Bloom::Kind kind : {v1::Bloom::KIND_MIP, v1::Bloom::KIND_CONSERVE, v1::Bloom::KIND_GAUSSIAN}) {
    for (v1::Metering::Statistic statistic :
         {v1::Metering::STATISTIC_LOG_AVERAGE, v1::Metering::STATISTIC_PERCENTILE}) {
      for (v1::Metering::Weights weights :
           {v1::Metering::WEIGHTS_AVERAGE, v1::Metering::WEIGHTS_CENTER, v1::Metering::WEIGHTS_SPOT}) {
        v1::Settings settings;
        settings.mutable_bloom()->set_kind(kind);
        settings.mutable_bloom()->set_intensity(0.5f);
        if (kind == v1::Bloom::KIND_GAUSSIAN) settings.mutable_bloom()->set_threshold(8.0f);
        v1::Metering& metering = *settings.mutable_exposure()->mutable_metering();
        metering.set_statistic(statistic);
        metering.set_weights(weights);
        *metering.mutable_spot() = rectangle(0, 0, 40, 5000);
        char what[60];
        std::snprintf(what, sizeof what, "bloom %d statistic %d weights %d", static_cast<int>(kind),
                      static_cast<int>(statistic), static_cast<int>(weights));
        all.emplace_back(what, settings);
      }
    }
  }
  return all;
}

TEST_F(FrameError, IsWithinItsBoundForEveryBloomKindAndMetering) {
  for (const Size& size : {Size{1, 1}, Size{5, 3}, Size{67, 67}, Size{333, 517}, Size{1279, 721}}) {
    print_header("bloom and metering at " + std::to_string(size.width) + "x" + std::to_string(size.height));
    for (const auto& [what, settings] : bloom_and_metering()) {
      check(natural(size.width, size.height), settings, what);
    }
  }
}

TEST_F(FrameError, IsWithinItsBoundInEveryHardCaseForEveryBloomKindAndMetering) {
  for (const HardCase& hard : hard_cases(67, 35)) {
    print_header(hard.name);
    for (const auto& [what, settings] : bloom_and_metering()) {
      check(make_frame(67, 35, v1::PIXEL_FORMAT_RGBA16F, hard.texel), settings, what);
    }
  }
}

TEST_F(FrameError, IsWithinItsBoundInEveryHardCase) {
  print_header("hard cases");
  for (const Size& size : {Size{1, 1}, Size{1, 7}, Size{3, 5}, Size{130, 67}}) {
    for (const HardCase& hard : hard_cases(size.width, size.height)) {
      for (v1::PixelFormat format : {v1::PIXEL_FORMAT_RGBA16F, v1::PIXEL_FORMAT_RGBA32F}) {
        check(make_frame(size.width, size.height, format, hard.texel), {},
              hard.name + " " + std::to_string(size.width) + "x" + std::to_string(size.height) + " " +
                  v1::word_of(format));
      }
    }
  }
}

// Light of both signs, where the limit of 2^60 decides which side of 0 the curve's matrix gives.
TEST_F(FrameError, IsWithinItsBoundAtTheLimitOfExposedLight) {
  print_header("(32768, -65504, 0) at 2^46");
  v1::Settings settings = at_ev(40);
  settings.set_prescale(64);
  settings.mutable_bloom()->set_intensity(0);
  check(make_frame(17, 5, v1::PIXEL_FORMAT_RGBA16F,
                   [](uint32_t, uint32_t) -> Texel {
                     return {32768, -65504, 0, 1};
                   }),
        settings, "limit");
}

TEST_F(FrameError, IsWithinItsBoundWithOtherPrimaries) {
  print_header("input primaries at 333x129");
  const std::pair<const char*, v1::Primaries> kinds[] = {
      {"Rec.2020", v1::PRIMARIES_REC2020},  {"P3-D65", v1::PRIMARIES_P3_D65},
      {"ACES AP0", v1::PRIMARIES_ACES_AP0}, {"ACES AP1", v1::PRIMARIES_ACES_AP1},
      {"CIE XYZ", v1::PRIMARIES_XYZ},
  };
  for (const auto& [label, primaries] : kinds) {
    for (v1::PixelFormat format :
         {v1::PIXEL_FORMAT_RGBA16F, v1::PIXEL_FORMAT_RGBA32F, v1::PIXEL_FORMAT_RGB9E5}) {
      v1::Settings settings;
      settings.set_input_primaries(primaries);
      // Where colours lie far outside of Rec.709, components of both signs cancel in the curve's matrix.
      check(natural(333, 129, format), settings, std::string(label) + " " + v1::word_of(format),
            {.max = 0.004});
    }
    for (const HardCase& hard : hard_cases(67, 35)) {
      v1::Settings settings;
      settings.set_input_primaries(primaries);
      check(make_frame(67, 35, v1::PIXEL_FORMAT_RGBA16F, hard.texel), settings,
            std::string(label) + " " + hard.name,
            hard.name == "saturated and negative" ? Bounds{.max = 0.2} : Bounds());
    }
  }
}

}  // namespace
}  // namespace candela::testing
