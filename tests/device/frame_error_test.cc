// The whole frame against the float64 reference: docs/pipeline.md section 6.
#include "tests/support/frame_error.h"

#include <gtest/gtest.h>

#include <cstdio>

namespace candela::testing {
namespace {

struct Size {
  uint32_t width;
  uint32_t height;
};

constexpr Size kSizes[] = {{1, 1},     {1, 7},     {2, 2},     {3, 5},     {4, 4},      {5, 3},
                           {17, 31},   {64, 64},   {65, 63},   {67, 67},   {127, 129},  {200, 1},
                           {333, 517}, {641, 359}, {16384, 1}, {1, 16384}, {1280, 720}, {1919, 1081}};

using FrameError = FrameErrorTest;

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
    for (ToneCurve curve : kCurves) {
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
    for (const HardCase& hard : hard_cases(67, 35)) {
      Settings settings;
      settings.input_chromaticities = chromaticities;
      check(make_frame(67, 35, PixelFormat::kRgba16f, hard.texel), settings,
            std::string(label) + " " + hard.name);
    }
  }
}

}  // namespace
}  // namespace candela::testing
