// Files with light outside of Rec.709, from the file to the picture.
#include <gtest/gtest.h>
#include <half.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <string>
#include <vector>

#include "client/image/image.h"
#include "server/render/color/aces.h"
#include "server/render/color/primaries.h"
#include "tests/cli/command.h"
#include "tests/cli/images.h"
#include "tests/support/files.h"
#include "tests/support/status.h"
#include "tests/support/wide_gamut.h"
#include "tests/unit/image/baked_environment_support.h"

namespace candela {
namespace {

using testing::Color;

constexpr uint32_t kChartWidth = 100;
constexpr uint32_t kChartHeight = 60;

class WideGamutFile : public ::testing::Test {
 protected:
  WideGamutFile() {
    // ACEScg, as halves.
    Image image = *make_image(kChartWidth, kChartHeight, ImageFormat::kRgba16f);
    const std::array<float, 9> to_rec709 = **matrix_to_rec709(chromaticities(v1::PRIMARIES_ACES_AP1));
    std::byte* to = image.pixels.data();
    for (const Color& c :
         testing::saturated_inside_ap1(v1::PRIMARIES_ACES_AP1, kChartWidth * kChartHeight).own) {
      const half pixel[] = {half(c[0]), half(c[1]), half(c[2]), half(1.0f)};
      std::memcpy(to, pixel, sizeof pixel);
      to += sizeof pixel;
      Color& light = rec709_.emplace_back();
      for (size_t r = 0; r < 3; ++r) {
        for (size_t k = 0; k < 3; ++k) light[r] += to_rec709[3 * r + k] * pixel[k];
      }
    }
    EXPECT_OK(write_image(ramp_, image));
  }

  nlohmann::json render(std::vector<std::string> options) const {
    options.insert(options.begin(), {"render", ramp_, out_, "--primaries", "aces-ap1", "--exposure", "0",
                                     "--bloom-intensity", "0"});
    return candela_json(options);
  }

  const TemporaryFolder folder_;
  const std::string ramp_ = folder_.path("ramp.exr");
  const std::string out_ = folder_.path("out.pfm");  // display-linear light
  std::vector<Color> rec709_;
};

TEST_F(WideGamutFile, AnAcescgRampByAces1IsWithin3CodesOfOpenColorIO) {
  const auto report = render({"--curve", "aces-1", "--verify"});
  ASSERT_OK_AND_ASSIGN(const Image picture, read_image(out_));
  double worst = 0.0;
  double sum = 0.0;
  for (size_t i = 0; i < rec709_.size(); ++i) {
    Color truth = rec709_[i];
    ASSERT_OK(aces_1(truth));
    std::array<float, 4> light;
    std::memcpy(light.data(), picture.pixels.data() + i * sizeof light, sizeof light);
    for (size_t k = 0; k < 3; ++k) {
      const double shown = std::clamp<double>(light[k], 0.0, 1.0);
      const double value = shown <= 0.0031308 ? 12.92 * shown : 1.055 * std::pow(shown, 1 / 2.4) - 0.055;
      const double codes = testing::codes_off(value, truth[k]);
      worst = std::max(worst, codes);
      sum += codes;
    }
  }
  EXPECT_LE(worst, 3.0);
  EXPECT_LE(sum / static_cast<double>(3 * rec709_.size()), 0.2);
  EXPECT_EQ(report["verify"]["against"], "OpenColorIO's aces-1 of the light, cut to ACES AP1");
  EXPECT_LE(report["verify"]["max_error_codes"], 3.0);
  EXPECT_EQ(report["gamut_cut_components"], 0);
}

TEST_F(WideGamutFile, WhatTheCurveCutsIsSaidAboveOnePercent) {
  const auto linear = render({"--curve", "linear"});
  EXPECT_GT(linear["gamut_cut_components"], kChartWidth * kChartHeight * 3 / 10);
  EXPECT_TRUE(
      says(linear["notes"].dump(),
           "% of the colour components lie outside the curve's gamut and were cut; the curve works on "
           "Rec.709's channels; --curve aces-2 keeps all of ACES AP1"))
      << linear["notes"];
  const auto aces = render({"--curve", "aces-1"});
  EXPECT_FALSE(says(aces["notes"].dump(), "were cut"));
  // The same numbers, taken for Rec.709, have nothing to cut.
  const auto plain = candela_json({"render", ramp_, out_, "--curve", "linear"});
  EXPECT_EQ(plain["gamut_cut_components"], 0);
}

// Files of kinds that people reported to other programs: what they say about their colours.

class FieldColour : public ::testing::Test {
 protected:
  void SetUp() override {
    if (data_folder().empty()) GTEST_SKIP() << "no test data: set CANDELA_DATA to its folder";
  }

  // Renders the file's light as it is, and expects this colour in Rec.709 everywhere. Returns the report.
  nlohmann::json expect_light(const std::string& name, const std::array<double, 3>& rgb) {
    const std::string out = folder_.path("out.pfm");
    nlohmann::json report = candela_json({"render", data_folder() + "/field/" + name, out, "--curve",
                                          "linear", "--exposure", "0", "--bloom-intensity", "0"});
    const std::vector<float> values = pfm_values(out);
    EXPECT_FALSE(values.empty());
    for (size_t i = 0; i < values.size(); ++i) EXPECT_NEAR(values[i], rgb[i % 3], 5e-4) << name << " " << i;
    return report;
  }

  static bool notes(const nlohmann::json& report, const std::string& words) {
    return report.at("notes").dump().find(words) != std::string::npos;
  }

  TemporaryFolder folder_;
};

TEST_F(FieldColour, ColorInteropIdNamesThePrimaries) {
  const auto report = expect_light("C01_interopid_ap1.exr", {0.7198, 0.1620, 0.0775});
  EXPECT_EQ(report.at("primaries").at("name"), "AP1");
  EXPECT_EQ(report.at("primaries").at("from"), "file");
  EXPECT_TRUE(report.at("notes").empty()) << report.at("notes");
}

TEST_F(FieldColour, TheAcesContainerFlagNamesAp0) {
  const auto report = expect_light("C02_acesflag.exr", {0.9953, 0.1267, 0.0786});
  EXPECT_EQ(report.at("primaries").at("name"), "AP0");
}

TEST_F(FieldColour, ColorInteropIdCountsBeforeChromaticitiesWithANote) {
  const auto report = expect_light("C06_id_beats_chroma.exr", {0.7198, 0.1620, 0.0775});
  EXPECT_TRUE(notes(report, "its colorInteropID lin_ap1_scene counts, against its chromaticities (Rec.709)"))
      << report.at("notes");
  EXPECT_EQ(report.at("notes").size(), 1u);
}

TEST_F(FieldColour, AnEncodedColorInteropIdIsDecoded) {
  const auto report = expect_light("C07_srgb_id.exr", {0.2140, 0.0331, 0.0100});
  EXPECT_TRUE(notes(report, "decoded from sRGB")) << report.at("notes");
}

TEST_F(FieldColour, AnAdoptedNeutralIsNotedAndWhiteBalanceUsesIt) {
  const auto report = expect_light("C08_adopted.exr", {0.5, 0.2, 0.1});
  EXPECT_TRUE(notes(report, "its adoptedNeutral, 0.3457 0.3585, is not used; --white-balance 5001"))
      << report.at("notes");
}

TEST_F(FieldColour, PrimariesThatAreAllZeroNameNone) {
  const std::string hdr = data_folder() + "/hdri/kiara_1_dawn_1k.hdr";
  const auto report = candela_json({"render", hdr, folder_.path("out.png")});
  EXPECT_EQ(report.at("primaries").at("from"), "assumed");
  EXPECT_FALSE(notes(report, "chromaticities")) << report.at("notes");
}

// Light of any size, from file to file: what users reported of suns and scenes in nits, and of objects on a
// transparent ground.

using Json = nlohmann::json;

// R, G and B of a pixel of a file of floats.
std::array<float, 3> pixel_of(const std::string& path, uint32_t x, uint32_t y) {
  const absl::StatusOr<Image> image = read_image(path);
  EXPECT_OK(image);
  std::array<float, 3> rgb{};
  if (!image.ok() || image->format != ImageFormat::kRgba32f) return rgb;
  std::memcpy(rgb.data(), image->pixels.data() + y * image->row_bytes() + size_t{x} * 16, sizeof rgb);
  return rgb;
}

// A picture of 64x32 floats: 0.5, and one pixel of `sun`.
void write_sun(const std::string& path, float sun) {
  ASSERT_OK_AND_ASSIGN(Image image, make_image(64, 32, ImageFormat::kRgba32f));
  for (uint32_t i = 0; i < 64 * 32; ++i) {
    const float v = i == 10 * 64 + 20 ? sun : 0.5f;
    const float pixel[4] = {v, v, v, 1};
    std::memcpy(image.pixels.data() + i * sizeof pixel, pixel, sizeof pixel);
  }
  ASSERT_OK(write_image(path, image));
}

class FieldLight : public ::testing::Test {
 protected:
  void SetUp() override {
    if (data_folder().empty()) GTEST_SKIP() << "no test data: set CANDELA_DATA to its folder";
  }

  std::string file(const std::string& name) const { return data_folder() + "/field/" + name; }
  // A pixel of the file's light at an exposure of `ev`, without anything else.
  std::array<float, 3> at_ev(const std::string& name, const std::string& ev, uint32_t x, uint32_t y) {
    const Outcome outcome = candela({"render", file(name), folder_.path("out.pfm"), "--curve", "linear",
                                     "--exposure=" + ev, "--bloom-intensity", "0"});
    EXPECT_EQ(outcome.code, 0) << outcome.err;
    return pixel_of(folder_.path("out.pfm"), x, y);
  }

  TemporaryFolder folder_;
};

TEST_F(FieldLight, LightBeyondHalvesIsMeteredAndExposedAsItIs) {
  const Json metered = candela_json({"meter", file("V03_bright.exr")});
  EXPECT_NEAR(metered.at("mean_log2_luminance").get<double>(), 17.11, 0.005);
  EXPECT_NEAR(at_ev("V03_bright.exr", "-20", 0, 0)[1], 0.954, 0.001);
}

TEST_F(FieldLight, ASunGivesTheHarmonicsOfAllItsLight) {
  const Json json = candela_json({"environment", file("V01_sun_5e5.exr"), folder_.path("a.ktx2"), "--sh",
                                  folder_.path("sh.json"), "--format", "rgba32f"});
  const Json sh = Json::parse(read_file(folder_.path("sh.json")), nullptr, false);
  const double expected[] = {8393.8, 7554.5, 6715.1};
  for (size_t k = 0; k < 3; ++k) {
    EXPECT_NEAR(sh.at("radiance")[0][k].get<double>(), expected[k], 1e-4 * expected[k]);
  }
  EXPECT_EQ(json.at("losses"), (Json{{"negative", 0}, {"clamped", 0}}));
}

TEST_F(FieldLight, ARadianceFileKeepsTheHueOfItsLight) {
  const auto rgb = at_ev("H11_sun.hdr", "-20", 0, 0);
  const double expected[] = {0.477, 0.381, 0.286};
  for (size_t k = 0; k < 3; ++k) EXPECT_NEAR(rgb[k], expected[k], 0.001);
}

TEST_F(FieldLight, ACandleOnATransparentGroundIsExposedAsACandle) {
  const Json metered = candela_json({"meter", data_folder() + "/exr/CandleGlass.exr"});
  EXPECT_NEAR(metered.at("target").get<double>(), 16.34, 0.005);
}

class LightOfAnySize : public ::testing::Test {
 protected:
  TemporaryFolder folder_;
  const std::string sun_ = folder_.path("sun.pfm");
};

TEST_F(LightOfAnySize, WhatIsBeyondTheMostIsCutCountedAndSaidOnce) {
  write_sun(sun_, 1e12f);
  const Json frame = candela_json({"render", sun_, folder_.path("out.png")});
  EXPECT_EQ(frame.at("clamped_components"), 3);
  EXPECT_EQ(frame.at("max_luminance").get<double>(), 1073741824.0);
  const Outcome outcome = candela({"render", sun_, folder_.path("out.png")});
  EXPECT_TRUE(says(outcome.err, "3 components beyond 2^30, the most that is rendered, were cut to that"));
  EXPECT_EQ(candela_json({"meter", sun_}).at("clamped_components"), 3);

  const Outcome refused = candela({"render", sun_, folder_.path("no.png"), "--bad-values", "reject"});
  EXPECT_NE(refused.code, 0);
  EXPECT_TRUE(says(refused.err, "x 20, y 10 is not within 2^30 (3 components beyond 2^30"));
}

TEST_F(LightOfAnySize, UpToTheMostNothingIsSaidOrRefused) {
  for (const float sun : {65505.0f, 5e5f, 1073741824.0f}) {
    write_sun(sun_, sun);
    const Outcome outcome =
        candela({"render", sun_, folder_.path("out.png"), "--bad-values", "reject", "--verify"});
    EXPECT_EQ(outcome.code, 0) << outcome.err;
    EXPECT_EQ(outcome.err, "") << sun;
    EXPECT_EQ(candela_json({"meter", sun_}).at("max_luminance").get<double>(), sun);
  }
}

TEST_F(LightOfAnySize, WhereTheLeastExposureHoldsItsOptionIsNamed) {
  absl::StatusOr<Image> image = make_image(8, 8, ImageFormat::kRgba32f);
  for (uint32_t i = 0; i < 64; ++i) {
    const float pixel[4] = {2e5f, 2e5f, 2e5f, 1};
    std::memcpy(image->pixels.data() + i * sizeof pixel, pixel, sizeof pixel);
  }
  ASSERT_OK(write_image(sun_, *image));
  const Outcome outcome = candela({"render", sun_, folder_.path("out.png")});
  EXPECT_TRUE(says(outcome.out + outcome.err, "held at --min-exposure 0.015625"));
}

TEST_F(LightOfAnySize, AnEnvironmentKeepsItAndAnOutputThatCannotHoldItSaysSo) {
  write_sun(sun_, 5e6f);
  const Json halves = candela_json({"environment", sun_, folder_.path("a.ktx2"), "--size", "64"});
  EXPECT_EQ(halves.at("losses").at("negative"), 0);
  EXPECT_GT(halves.at("losses").at("clamped").get<int>(), 0);
  EXPECT_TRUE(says(halves.at("notes").dump(), "--format rgba32f keeps them")) << halves;

  for (const std::string out : {"b.ktx2", "b.exr", "b/"}) {
    const Json floats =
        candela_json({"environment", sun_, folder_.path(out), "--size", "64", "--format", "rgba32f"});
    EXPECT_EQ(floats.at("losses"), (Json{{"negative", 0}, {"clamped", 0}})) << out;
    EXPECT_EQ(floats.at("format"), "rgba32f");
  }
  const Ktx2 file = parse_ktx2(folder_.path("b.ktx2"));
  double brightest = 0;
  for (uint32_t i = 0; i < 6 * 64 * 64; ++i) {
    brightest = std::max(brightest, file.texel(0, i / 4096, i % 64, i / 64 % 64)[0]);
  }
  EXPECT_GT(brightest, 65504);
  EXPECT_LE(brightest, 5e6);
}

TEST_F(LightOfAnySize, AViewShowsASunAsBrightAsItIs) {
  write_sun(sun_, 5e6f);
  // Pixel (20, 10) is at -64.7 degrees and 30.9 degrees up.
  const Json frame = candela_json({"view", sun_, folder_.path("view.png"), "--size", "64x64", "--yaw=-64.7",
                                   "--pitch", "30.9", "--fov", "10", "--verify"});
  EXPECT_GT(frame.at("max_luminance").get<double>(), 1e6);
  EXPECT_LE(frame.at("verify").at("max_error_codes").get<double>(), 0.5);
}

}  // namespace
}  // namespace candela
