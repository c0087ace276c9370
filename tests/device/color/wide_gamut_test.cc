// Light outside of Rec.709 reaches the curve, which cuts it in its own primaries and counts what it cuts.
#include "tests/support/wide_gamut.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <map>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "proto/candela/v1/settings.h"
#include "server/render/color/aces.h"
#include "tests/support/device_fixture.h"
#include "tests/support/settings.h"
#include "tests/support/status.h"

namespace candela::testing {
namespace {

constexpr v1::Primaries kPrimaries[] = {v1::PRIMARIES_ACES_AP1, v1::PRIMARIES_ACES_AP0, v1::PRIMARIES_P3_D65,
                                        v1::PRIMARIES_REC2020};

// Exposure 1 and no bloom, so that the scene's light is the exposed light.
v1::Settings with_curve(v1::ToneCurve curve) {
  v1::Settings settings = plain();
  settings.set_curve(curve);
  settings.set_output_format(v1::OUTPUT_FORMAT_RGBA16);
  return settings;
}

WireFrame frame_of(const std::vector<Color>& colors, uint32_t width) {
  const auto height = static_cast<uint32_t>(colors.size() / width);
  return make_frame(width, height, v1::PIXEL_FORMAT_RGBA32F, [&](uint32_t x, uint32_t y) {
    const Color& c = colors[size_t{y} * width + x];
    return Texel{c[0], c[1], c[2], 1.0f};
  });
}

class WideGamut : public DeviceTest {
 protected:
  struct Error {
    double max = 0.0;
    double mean = 0.0;
  };
  // Of the image of aces-1, against OpenColorIO's result for the colours as they are.
  static Error error_of_aces_1(const Saturated& colors, v1::Primaries primaries, const char* tier) {
    constexpr uint32_t kWidth = 200;
    v1::Settings settings = with_curve(v1::TONE_CURVE_ACES_1);
    settings.set_input_primaries(primaries);
    settings.set_tier(tier);
    const auto rendered = render(frame_of(colors.own, kWidth), settings);
    EXPECT_OK(rendered);
    if (!rendered.ok()) return {INFINITY, INFINITY};
    Error error;
    for (size_t i = 0; i < colors.rec709.size(); ++i) {
      Color truth = colors.rec709[i];
      EXPECT_OK(aces_1(truth));
      const std::byte* texel =
          rendered->memory.output_row(static_cast<uint32_t>(i / kWidth)).data() + i % kWidth * 8;
      for (size_t k = 0; k < 3; ++k) {
        uint16_t value;
        std::memcpy(&value, texel + 2 * k, sizeof value);
        const double codes = codes_off(value / 65535.0, truth[k]);
        error.max = std::max(error.max, codes);
        error.mean += codes / static_cast<double>(3 * colors.rec709.size());
      }
    }
    return error;
  }
};

TEST_F(WideGamut, SaturatedColoursInsideAp1AreWithin3CodesOfOpenColorIO) {
  std::printf("aces-1 against OpenColorIO  %-10s %-10s %8s %8s\n", "primaries", "tier", "max", "mean");
  for (const v1::Primaries primaries : kPrimaries) {
    const Saturated colors = saturated_inside_ap1(primaries, 20000);
    for (const auto& [tier, max, mean] : {std::tuple("draft", 12.0, 0.2), std::tuple("standard", 3.0, 0.2),
                                          std::tuple("reference", 0.02, 0.01)}) {
      const Error error = error_of_aces_1(colors, primaries, tier);
      std::printf("%27s %-10s %-10s %8.3f %8.4f\n", "", v1::word_of(primaries).c_str(), tier, error.max,
                  error.mean);
      EXPECT_LE(error.max, max) << v1::word_of(primaries) << " " << tier;
      EXPECT_LE(error.mean, mean) << v1::word_of(primaries) << " " << tier;
    }
  }
}

TEST_F(WideGamut, EveryCurveCountsWhatItCutsAsItsTwinDoes) {
  // Colours of AP0 also outside of AP1, in a frame with a partial group of texels.
  std::vector<Color> colors;
  for (uint32_t i = 0; i < 131 * 67; ++i) {
    const float light = std::exp2(static_cast<float>(i % 97) / 8.0f - 8.0f);
    colors.push_back({light * noise(i, 0, 0), i % 3 == 0 ? 0.0f : light * noise(i, 0, 1),
                      i % 5 == 0 ? 0.0f : light * noise(i, 0, 2)});
  }
  const WireFrame frame = frame_of(colors, 131);
  std::vector<v1::ToneCurve> curves(std::begin(kCurves), std::end(kCurves));
  curves.push_back(v1::TONE_CURVE_ACES_1);
  std::map<v1::ToneCurve, uint64_t> counts;
  for (const v1::ToneCurve curve : curves) {
    v1::Settings settings = with_curve(curve);
    settings.set_input_primaries(v1::PRIMARIES_ACES_AP0);
    ASSERT_OK_AND_ASSIGN(const auto rendered, render(frame, settings, {}, Verify::kYes));
    const FrameReport& report = rendered.report;
    EXPECT_EQ(report.gamut_cut_components, report.verification->gamut_cut_components) << v1::word_of(curve);
    EXPECT_EQ(report.stats.negative_scene_components, report.verification->truth.negative_scene_components);
    EXPECT_EQ(report.stats.negative_components, 0u);
    if (curve != v1::TONE_CURVE_ACES_1) {
      EXPECT_LE(report.verification->rounded.max_codes, 0.5) << v1::word_of(curve);
    }
    counts[curve] = report.gamut_cut_components;
    settings.set_tier("reference");
    ASSERT_OK_AND_ASSIGN(const auto on_host, render(frame, settings));
    EXPECT_NEAR(static_cast<double>(on_host.report.gamut_cut_components), static_cast<double>(counts[curve]),
                1e-3 * static_cast<double>(colors.size()));
  }
  EXPECT_GT(counts[v1::TONE_CURVE_LINEAR], colors.size() / 4);
  EXPECT_EQ(counts[v1::TONE_CURVE_LINEAR], counts[v1::TONE_CURVE_PBR_NEUTRAL]);
  EXPECT_LT(counts[v1::TONE_CURVE_ACES_1], counts[v1::TONE_CURVE_LINEAR]);
  EXPECT_LT(counts[v1::TONE_CURVE_ACES_HILL], counts[v1::TONE_CURVE_ACES_1]);
  EXPECT_GT(counts[v1::TONE_CURVE_ACES_HILL], 0u);
}

// OpenColorIO alone would shift the hue of light outside of AP1 before it cuts.
TEST_F(WideGamut, EveryTierCutsAces1ToAp1First) {
  constexpr uint32_t kSide = 64;
  std::vector<Color> colors;  // of AP1, and some outside of it
  for (uint32_t i = 0; i < kSide * kSide; ++i) {
    const float light = std::exp2(static_cast<float>(i % 89) / 8.0f - 6.0f);
    colors.push_back(
        {light * noise(i, 1, 0), light * (noise(i, 1, 1) - 0.3f), light * (noise(i, 1, 2) - 0.3f)});
  }
  const auto rendered_by = [](const std::vector<Color>& of, const char* tier) {
    v1::Settings settings = with_curve(v1::TONE_CURVE_ACES_1);
    settings.set_input_primaries(v1::PRIMARIES_ACES_AP1);
    settings.set_tier(tier);
    return render(frame_of(of, kSide), settings, {}, Verify::kYes);
  };
  ASSERT_OK_AND_ASSIGN(const auto reference, rendered_by(colors, "reference"));
  ASSERT_OK_AND_ASSIGN(const auto standard, rendered_by(colors, "standard"));
  EXPECT_GT(reference.report.gamut_cut_components, colors.size() / 4);
  EXPECT_LE(standard.report.verification->rounded.max_codes, 6.0);  // as inside of AP1
  // The cut is all that happens to them.
  std::vector<Color> inside = colors;
  for (Color& c : inside) {
    for (float& v : c) v = std::max(v, 0.0f);
  }
  ASSERT_OK_AND_ASSIGN(const auto cut, rendered_by(inside, "reference"));
  double most = 0;
  for (uint32_t y = 0; y < kSide; ++y) {
    for (uint32_t i = 0; i < kSide * 4; ++i) {
      uint16_t is, should;
      std::memcpy(&is, reference.memory.output_row(y).data() + 2 * i, sizeof is);
      std::memcpy(&should, cut.memory.output_row(y).data() + 2 * i, sizeof should);
      most = std::max(most, std::abs(is - should) / 257.0);
    }
  }
  EXPECT_LE(most, 0.02) << "codes";
}

// A component of the scene is negative below -2^-25, 3.0e-8, where its half is not 0.
TEST_F(WideGamut, LightThatRoundsToZeroAfterAMatrixIsNotNegative) {
  // Red of AP1, whose green is -0.13 in Rec.709.
  for (const auto& [red, negative] :
       std::vector<std::pair<float, uint64_t>>{{1e-17f, 0}, {2.2e-7f, 0}, {2.4e-7f, 1}, {1.0f, 2}}) {
    const WireFrame frame = make_frame(40, 40, v1::PIXEL_FORMAT_RGBA32F, [red = red](uint32_t x, uint32_t y) {
      return x == 7 && y == 9 ? Texel{red, 0, 0, 1} : Texel{0.3f, 0.3f, 0.3f, 1};
    });
    for (const char* tier : {"standard", "reference"}) {
      v1::Settings settings = with_curve(v1::TONE_CURVE_LINEAR);
      settings.set_input_primaries(v1::PRIMARIES_ACES_AP1);
      settings.set_tier(tier);
      ASSERT_OK_AND_ASSIGN(const auto rendered, render(frame, settings, {}, Verify::kYes));
      const FrameReport& report = rendered.report;
      EXPECT_EQ(report.stats.negative_scene_components, negative) << red << " " << tier;
      EXPECT_EQ(report.verification->truth.negative_scene_components, negative) << red << " " << tier;
      EXPECT_EQ(report.plan.resolve.inputs.constants.wide, negative > 0) << red << " " << tier;
    }
  }
}

// So it is rounded like its neighbours, also in a frame with light that is negative.
TEST_F(WideGamut, LightThatRoundsToZeroIsRoundedWithItsColour) {
  const auto codes = [](float least, ExecutorKind executor) {
    const WireFrame frame = make_frame(40, 40, v1::PIXEL_FORMAT_RGBA32F, [least](uint32_t x, uint32_t) {
      return x == 0 ? Texel{1, -0.5f, 0, 1} : Texel{0.1f, 0.7f, least, 1};
    });
    const auto rendered = render_on(renderer_with(executor), frame, with_curve(v1::TONE_CURVE_LINEAR));
    EXPECT_OK(rendered);
    return rendered.ok() ? image(rendered->memory) : std::vector<std::byte>();
  };
  for (const ExecutorKind executor : {ExecutorKind::kDevice, ExecutorKind::kHost}) {
    EXPECT_EQ(codes(-0x1p-25f, executor), codes(0.0f, executor));
    EXPECT_NE(codes(-0x1p-24f, executor), codes(0.0f, executor));  // here R and G are not halves
  }
}

TEST_F(WideGamut, NothingIsCutOfAFrameWithoutNegativeComponents) {
  const auto natural = scenes::natural(67, 33);
  const WireFrame frame = make_frame(67, 33, v1::PIXEL_FORMAT_RGBA16F, [&](uint32_t x, uint32_t y) {
    const Texel c = natural(x, y);
    return Texel{std::abs(c[0]), std::abs(c[1]), std::abs(c[2]), c[3]};
  });
  for (const v1::ToneCurve curve : kCurves) {
    ASSERT_OK_AND_ASSIGN(const auto rendered, render(frame, with_curve(curve)));
    EXPECT_EQ(rendered.report.gamut_cut_components, 0u);
    EXPECT_EQ(rendered.report.plan.resolve.inputs.constants.wide, 0u);
  }
}

TEST_F(WideGamut, ColoursInsideTheCurvesGamutAreNotCut) {
  v1::Settings settings = with_curve(v1::TONE_CURVE_ACES_1);
  settings.set_input_primaries(v1::PRIMARIES_ACES_AP1);
  // Most are on the edge of the gamut, so the scene's halves are on either side of it.
  ASSERT_OK_AND_ASSIGN(
      const auto rendered,
      render(frame_of(saturated_inside_ap1(v1::PRIMARIES_ACES_AP1, 4000).own, 200), settings));
  EXPECT_EQ(rendered.report.plan.resolve.inputs.constants.wide, 1u);
  EXPECT_EQ(rendered.report.gamut_cut_components, 0u);
}

TEST_F(WideGamut, CountsTheSameThroughStagingCopiesAndWithVerification) {
  DeviceOptions options;
  options.staging = true;
  ASSERT_OK_AND_ASSIGN(auto staged_device, Device::create(options));
  TexturePool staged_pool(*staged_device, uint64_t{1} << 30, real_clock());
  ASSERT_OK_AND_ASSIGN(auto staged, Renderer::create(*staged_device, staged_pool));
  const WireFrame frame = make_frame(131, 67, v1::PIXEL_FORMAT_RGBA16F, [](uint32_t x, uint32_t y) {
    return Texel{1.0f, x % 2 == 0 ? -0.5f : 0.5f, y % 3 == 0 ? -1e-5f : 0.0f, 1.0f};
  });
  const uint64_t expected = 66 * 67;  // -1e-5 beside 1 is the rounding of a half
  for (const Verify verify : {Verify::kNo, Verify::kYes}) {
    ASSERT_OK_AND_ASSIGN(const auto here, render_on(renderer_with(ExecutorKind::kDevice), frame,
                                                    with_curve(v1::TONE_CURVE_LINEAR), {}, verify));
    ASSERT_OK_AND_ASSIGN(const auto there,
                         render_on(*staged, frame, with_curve(v1::TONE_CURVE_LINEAR), {}, verify));
    EXPECT_EQ(here.report.gamut_cut_components, expected);
    EXPECT_EQ(there.report.gamut_cut_components, expected);
    EXPECT_EQ(image(here.memory), image(there.memory));
  }
}

TEST_F(WideGamut, AFrameThatIsScrubbedIsCutAndCounted) {
  const WireFrame frame = make_frame(67, 33, v1::PIXEL_FORMAT_RGBA32F, [](uint32_t x, uint32_t) {
    return x == 3 ? Texel{NAN, -INFINITY, 1.0f, 1.0f} : Texel{1.0f, -0.5f, 0.5f, 1.0f};
  });
  ASSERT_OK_AND_ASSIGN(const auto rendered,
                       render(frame, with_curve(v1::TONE_CURVE_ACES_HILL), {}, Verify::kYes));
  EXPECT_EQ(rendered.report.stats.negative_scene_components, 67u * 33u);
  EXPECT_EQ(rendered.report.gamut_cut_components, rendered.report.verification->gamut_cut_components);
}

}  // namespace
}  // namespace candela::testing
