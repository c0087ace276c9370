// The curves that use a table: aces-1 against OpenColorIO and published renders, and a client's table against
// its float64 look-up.
#include <gtest/gtest.h>
#include <half.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <random>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "client/image/image.h"
#include "proto/candela/v1/settings.h"
#include "server/render/color/aces.h"
#include "server/render/color/primaries.h"
#include "shaders/reference.h"
#include "tests/support/device_fixture.h"
#include "tests/support/files.h"
#include "tests/support/settings.h"
#include "tests/support/status.h"
#include "tests/support/wide_gamut.h"
#include "tests/unit/image/png.h"

namespace candela::testing {
namespace {

namespace fs = std::filesystem;

class Table : public DeviceTest {
 protected:
  static Verification difference(const WireFrame& frame, const v1::Settings& settings,
                                 const std::string& what) {
    const auto rendered = render(frame, settings, {}, Verify::kYes);
    EXPECT_OK(rendered) << what;
    if (!rendered.ok()) return {};
    const Verification& d = rendered->report.verification->rounded;
    std::printf("%-44s %9.5f %9.5f %9.6f\n", what.c_str(), d.max_codes, d.p999_codes, d.mean_codes);
    return d;
  }

  static void print_header(const char* what) {
    std::printf("%-44s %9s %9s %9s\n", what, "max", "p99.9", "mean");
  }

  static v1::Settings with(v1::ToneCurve curve) {
    v1::Settings settings;
    settings.set_curve(curve);
    return settings;
  }

  static v1::Settings with_table(uint32_t size) {
    v1::Settings settings = with(v1::TONE_CURVE_TABLE);
    *settings.mutable_table() = to_message(**aces_1_table(size));
    return settings;
  }
};

TEST_F(Table, Aces1IsWithinItsPublishedBoundOfOpenColorIO) {
  print_header("aces-1, codes against OpenColorIO");
  for (const Size& size : {Size{1, 1}, Size{3, 5}, Size{67, 67}, Size{333, 517}, Size{641, 359}}) {
    const std::string what = std::to_string(size.width) + "x" + std::to_string(size.height);
    const Verification d = difference(natural(size.width, size.height), with(v1::TONE_CURVE_ACES_1), what);
    EXPECT_LE(d.max_codes, 1.4) << what;
    EXPECT_LE(d.p999_codes, 0.7) << what;
    EXPECT_LE(d.mean_codes, 0.08) << what;
  }
  for (const HardCase& hard : hard_cases(130, 67)) {
    const Verification d = difference(make_frame(130, 67, v1::PIXEL_FORMAT_RGBA16F, hard.texel),
                                      with(v1::TONE_CURVE_ACES_1), hard.name);
    EXPECT_LE(d.max_codes, 1.4) << hard.name;
  }
}

TEST_F(Table, OfAClientIsItsFloat64LookUp) {
  print_header("table, codes against float64");
  for (uint32_t size : {2u, 3u, 17u, 33u, 65u}) {
    for (const Size& frame : {Size{1, 1}, Size{3, 5}, Size{333, 129}}) {
      const std::string what =
          std::to_string(size) + "^3, " + std::to_string(frame.width) + "x" + std::to_string(frame.height);
      EXPECT_LE(difference(natural(frame.width, frame.height), with_table(size), what).max_codes, 0.01)
          << what;
    }
    for (const HardCase& hard : hard_cases(130, 67)) {
      const std::string what = std::to_string(size) + "^3, " + hard.name;
      EXPECT_LE(difference(make_frame(130, 67, v1::PIXEL_FORMAT_RGBA32F, hard.texel), with_table(size), what)
                    .max_codes,
                0.01)
          << what;
    }
  }
}

TEST_F(Table, WithNoiseInEveryPointIsItsFloat64LookUp) {
  print_header("noise in every point");
  for (uint32_t axes : {shader::AXES_ACES, shader::AXES_REC709, shader::AXES_AP1}) {
    auto table = std::make_shared<ColorTable>(ColorTable{9, axes, 8.0f, {}});
    for (uint32_t i = 0; i < 9 * 9 * 9 * 3; ++i)
      table->values.push_back(static_cast<uint16_t>(65535.0f * noise(i, 0, 0)));
    v1::Settings settings = with(v1::TONE_CURVE_TABLE);
    *settings.mutable_table() = to_message(*table);
    EXPECT_LE(difference(natural(333, 129), settings, "9^3, axes " + std::to_string(axes)).max_codes, 0.1);
  }
}

TEST_F(Table, TransferAndFormatApplyToAces1ButNotToATable) {
  const WireFrame frame = natural(67, 33);
  for (v1::Transfer transfer : {v1::TRANSFER_SRGB, v1::TRANSFER_GAMMA22, v1::TRANSFER_LINEAR}) {
    for (v1::OutputFormat format : {v1::OUTPUT_FORMAT_RGBA16, v1::OUTPUT_FORMAT_RGBA16F}) {
      v1::Settings settings = with(v1::TONE_CURVE_ACES_1);
      settings.set_transfer(transfer);
      settings.set_output_format(format);
      const std::string what = v1::word_of(transfer) + " " + v1::word_of(format);
      EXPECT_LE(difference(frame, settings, what).max_codes, 2.0) << what;

      v1::Settings view = with_table(65);
      view.set_output_format(format);
      ASSERT_OK_AND_ASSIGN(auto plain, render(frame, view));
      view.set_transfer(transfer);
      ASSERT_OK_AND_ASSIGN(auto other, render(frame, view));
      EXPECT_EQ(image(plain.memory), image(other.memory)) << what;
    }
  }
}

TEST_F(Table, FramesAlternatingBetweenMoreTablesThanAreKeptStayThemselves) {
  const WireFrame frame = natural(67, 33);
  std::vector<std::vector<std::byte>> first;
  for (int round = 0; round < 3; ++round) {
    for (uint32_t i = 0; i < 7; ++i) {
      ASSERT_OK_AND_ASSIGN(auto rendered, render(frame, with_table(5 + i)));
      if (round == 0) first.push_back(image(rendered.memory));
      EXPECT_EQ(image(rendered.memory), first[i]) << round << " " << i;
    }
  }
}

TEST_F(Table, IsTheSameThroughStagingCopies) {
  DeviceOptions options;
  options.staging = true;
  ASSERT_OK_AND_ASSIGN(auto staged_device, Device::create(options));
  TexturePool staged_pool(*staged_device, uint64_t{1} << 30, real_clock());
  ASSERT_OK_AND_ASSIGN(auto staged, Renderer::create(*staged_device, staged_pool));
  const WireFrame frame = natural(67, 33);
  for (int round = 0; round < 2; ++round) {
    ASSERT_OK_AND_ASSIGN(auto here,
                         render_on(renderer_with(ExecutorKind::kDevice), frame, with(v1::TONE_CURVE_ACES_1)));
    ASSERT_OK_AND_ASSIGN(auto there, render_on(*staged, frame, with(v1::TONE_CURVE_ACES_1)));
    EXPECT_EQ(image(here.memory), image(there.memory));
  }
}

TEST_F(Table, Aces1AgreesWithThePublishedRenders) {
  if (data_folder().empty()) GTEST_SKIP() << "no test images; set CANDELA_DATA";
  const fs::path data = data_folder();
  struct Case {
    const char* input;
    const char* render;
    bool ap0;  // the file is AP0 but does not say so
    double max = 1.0;
  };
  const Case cases[] = {{"exr/Carrots.exr", "Carrots", false, 1.2},
                        {"exr/StillLife.exr", "StillLife", false},
                        // Noise far outside of AP1.
                        {"exr/Desk.exr", "Desk", false, 3.5},
                        {"exr/GoldenGate.exr", "GoldenGate", false},
                        {"exr/GrayRampsDiagonal.exr", "GrayRampsDiagonal", false},
                        {"exr/WideColorGamut.exr", "WideColorGamut", false, 2.3},
                        {"exr/Flowers.exr", "Flowers", false},
                        {"aces/target_ricd_190spectra.exr", "target_ricd_190spectra", true},
                        {"aces/ACES2065-1_ColorChecker2005.exr", "ColorChecker2005", true}};
  print_header("aces-1, codes beyond the file's own rounding");
  for (const Case& c : cases) {
    ASSERT_OK_AND_ASSIGN(const Image input, read_image(data / c.input));
    const Png png = read_png(data / "aces" / (std::string(c.render) + ".aces1_srgb.png"));
    ASSERT_EQ(png.width, input.width) << c.render;
    ASSERT_EQ(png.height, input.height) << c.render;
    v1::Settings settings = plain();
    settings.set_curve(v1::TONE_CURVE_ACES_1);
    settings.set_output_format(v1::OUTPUT_FORMAT_RGBA16);
    if (c.ap0 && !input.chromaticities) settings.set_input_primaries(v1::PRIMARIES_ACES_AP0);
    settings.MergeFrom(settings_of(input));
    ASSERT_OK_AND_ASSIGN(auto rendered, render(frame_of(input), settings));
    const double most = png.depth == 16 ? 65535 : 255, half_code = 255 / most / 2;
    std::vector<float> codes;
    for (uint32_t y = 0; y < png.height; ++y) {
      const std::byte* row = rendered.memory.output_row(y).data();
      for (uint32_t x = 0; x < png.width; ++x) {
        for (size_t k = 0; k < 3; ++k) {
          uint16_t value;
          std::memcpy(&value, row + 8 * x + 2 * k, sizeof value);
          const double code = png.code(x, y, static_cast<int>(k));
          const double off = std::abs(value / 65535.0 - code / most) * 255.0 - half_code;
          codes.push_back(static_cast<float>(std::max(off, 0.0)));
        }
      }
    }
    ASSERT_FALSE(codes.empty()) << c.render;
    double sum = 0.0;
    for (float code : codes) sum += code;
    std::sort(codes.begin(), codes.end());
    const double p999 = codes[static_cast<size_t>(static_cast<double>(codes.size() - 1) * 0.999)];
    std::printf("%-44s %9.5f %9.5f %9.6f\n", c.render, codes.back(), p999,
                sum / static_cast<double>(codes.size()));
    EXPECT_LE(codes.back(), c.max) << c.render;
    EXPECT_LE(p999, 0.6) << c.render;
  }
}

// Light outside of Rec.709 reaches the curve, which cuts it in its own primaries and counts what it cuts.

constexpr v1::Primaries kPrimaries[] = {v1::PRIMARIES_ACES_AP1, v1::PRIMARIES_ACES_AP0, v1::PRIMARIES_P3_D65,
                                        v1::PRIMARIES_REC2020};

// Exposure 1 and no bloom, so that the scene's light is the exposed light.
v1::Settings with_curve(v1::ToneCurve curve) {
  v1::Settings settings = plain();
  settings.set_curve(curve);
  settings.set_output_format(v1::OUTPUT_FORMAT_RGBA16);
  return settings;
}

WireFrame frame_of_colors(const std::vector<Color>& colors, uint32_t width) {
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
    const auto rendered = render(frame_of_colors(colors.own, kWidth), settings);
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
  const WireFrame frame = frame_of_colors(colors, 131);
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
    return render(frame_of_colors(of, kSide), settings, {}, Verify::kYes);
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
    v1::Settings settings = with_curve(v1::TONE_CURVE_LINEAR);
    settings.set_output_format(v1::OUTPUT_FORMAT_RGBA16F);  // an image of 16 bits keeps the scene's floats
    settings.set_prescale(0.7);
    const auto rendered = render_on(renderer_with(executor), frame, settings);
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
      render(frame_of_colors(saturated_inside_ap1(v1::PRIMARIES_ACES_AP1, 4000).own, 200), settings));
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

// The curve aces-2 as the executors make it, against the float64 reference and OpenColorIO's own values.

using Color = std::array<float, 3>;

v1::Settings aces_2_of(v1::Primaries primaries) {
  v1::Settings settings = plain();
  settings.set_curve(v1::TONE_CURVE_ACES_2);
  settings.set_input_primaries(primaries);
  settings.set_output_format(v1::OUTPUT_FORMAT_RGBA16);
  return settings;
}

// Any light of 2^-12 .. 2^10, saturated light, light on the faces of the primaries' cube, and greys.
std::vector<Color> hostile_colors(size_t count) {
  std::mt19937_64 random(3);
  const auto uniform = [&random](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  std::vector<Color> colors(count);
  for (size_t i = 0; i < count; ++i) {
    const double light = std::exp2(uniform(-12, 10));
    for (float& v : colors[i]) {
      const double part = i % 3 == 0   ? std::exp2(uniform(-12, 0))
                          : i % 3 == 1 ? std::exp2(uniform(-20, 0))
                                       : uniform(0, 1);
      v = static_cast<float>(light * part);
    }
    if (i % 3 == 2) colors[i][i / 3 % 3] = 0;
    if (i % 8 == 7) colors[i].fill(static_cast<float>(light));
  }
  return colors;
}

class Aces2Passes : public DeviceTest {
 protected:
  // The largest distance of the image's R, G and B from display signals, in codes of 255, over `counted`.
  static double codes_off(const std::vector<Color>& colors, v1::Primaries primaries,
                          const nlohmann::json& signals, const nlohmann::json& counted) {
    constexpr uint32_t kWidth = 61;
    const auto rendered = render(chart_of(colors, kWidth), aces_2_of(primaries));
    EXPECT_OK(rendered);
    if (!rendered.ok()) return INFINITY;
    double worst = 0;
    for (size_t i = 0; i < colors.size(); ++i) {
      if (!counted.empty() && counted[i] == 0) continue;
      const std::byte* const texel =
          rendered->memory.output_row(static_cast<uint32_t>(i / kWidth)).data() + i % kWidth * 8;
      for (size_t k = 0; k < 3; ++k) {
        uint16_t code;
        std::memcpy(&code, texel + 2 * k, sizeof code);
        const double want = std::clamp(signals[i][k].get<double>(), 0.0, 1.0);
        worst = std::max(worst, 255 * std::abs(code / 65535.0 - want));
      }
    }
    return worst;
  }

  static nlohmann::json data(const char* name) {
    return nlohmann::json::parse(read_file(data_folder() + "/aces2/" + name));
  }
};

TEST_F(Aces2Passes, AreWithinTheirBoundOfFloat64) {
  const std::vector<Color> colors = hostile_colors(300 * 200);
  struct Case {
    v1::Primaries primaries;
    v1::Transfer transfer;
    double bound;
  };
  std::printf("aces-2 against float64, codes: max, p99.9, mean\n");
  for (const Case& one : {Case{v1::PRIMARIES_REC709, v1::TRANSFER_SRGB, 0.04},
                          Case{v1::PRIMARIES_REC709, v1::TRANSFER_GAMMA22, 1.5},
                          Case{v1::PRIMARIES_REC709, v1::TRANSFER_LINEAR, 0.05},
                          Case{v1::PRIMARIES_ACES_AP1, v1::TRANSFER_SRGB, 0.3},
                          Case{v1::PRIMARIES_ACES_AP1, v1::TRANSFER_GAMMA22, 3},
                          Case{v1::PRIMARIES_ACES_AP1, v1::TRANSFER_LINEAR, 0.08}}) {
    v1::Settings settings = aces_2_of(one.primaries);
    settings.set_transfer(one.transfer);
    for (const ExecutorKind kind : {ExecutorKind::kHost, ExecutorKind::kDevice}) {
      const auto rendered = render_on(renderer_with(kind), chart_of(colors, 300), settings, {}, Verify::kYes);
      ASSERT_OK(rendered);
      const Verification& d = rendered->report.verification->rounded;
      std::printf("%-8s %-8s %-7s %8.4f %8.4f %8.5f\n", v1::word_of(one.primaries).c_str(),
                  v1::word_of(one.transfer).c_str(), executor_word(kind), d.max_codes, d.p999_codes,
                  d.mean_codes);
      EXPECT_LE(d.max_codes, one.bound) << v1::word_of(one.primaries) << " " << v1::word_of(one.transfer);
      EXPECT_LE(d.p999_codes, 0.01);
    }
  }
}

// The image has 16 bits, and so the scene its floats.
TEST_F(Aces2Passes, AreWithinATenthOfACodeOfOpenColorIO) {
  if (data_folder().empty()) GTEST_SKIP() << "no test data; set CANDELA_DATA";
  const nlohmann::json points = data("points.json");
  const auto colors = points["aces2065_1"].get<std::vector<Color>>();
  const nlohmann::json expected = data("expected.json");
  for (const nlohmann::json& output : expected["outputs"]) {
    if (output["builtin"] != "ACES-OUTPUT - ACES2065-1_to_CIE-XYZ-D65 - SDR-100nit-REC709_2.0") continue;
    const nlohmann::json& signals = output["displays"]["DISPLAY - CIE-XYZ-D65_to_sRGB"];
    const double worst = codes_off(colors, v1::PRIMARIES_ACES_AP0, signals, points["inside_ap1"]);
    const double outside = codes_off(colors, v1::PRIMARIES_ACES_AP0, signals, {});
    std::printf("%zu colours: at most %.3f codes inside of AP1, %.3f with those outside\n", colors.size(),
                worst, outside);
    EXPECT_LE(worst, 0.1);
    EXPECT_LE(outside, 0.1);
    EXPECT_GT(worst, 0.001) << "nothing was compared";
    return;
  }
  FAIL() << "no such output";
}

TEST_F(Aces2Passes, ShowTheConfigurationsView) {
  if (data_folder().empty()) GTEST_SKIP() << "no test data; set CANDELA_DATA";
  const nlohmann::json config = data("config_views.json");
  const auto colors = config["inputs"].get<std::vector<Color>>();
  int views = 0;
  for (const nlohmann::json& view : config["views"]) {
    if (view["view"] != "ACES 2.0 - SDR 100 nits (Rec.709)") continue;
    const std::string space = view["colorspace"];
    const v1::Primaries primaries = space == "ACES2065-1" ? v1::PRIMARIES_ACES_AP0
                                    : space == "ACEScg"   ? v1::PRIMARIES_ACES_AP1
                                                          : v1::PRIMARIES_REC709;
    const double worst = codes_off(colors, primaries, view["rgb"], {});
    std::printf("%s: at most %.3f codes\n", space.c_str(), worst);
    EXPECT_LE(worst, 0.1) << space;
    ++views;
  }
  EXPECT_EQ(views, 3);
}

}  // namespace
}  // namespace candela::testing
