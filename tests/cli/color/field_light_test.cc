// Light of any size, from file to file: what users reported of suns and scenes in nits, and of objects on a
// transparent ground.
#include <gtest/gtest.h>

#include <array>
#include <cstring>

#include "client/image/image.h"
#include "tests/cli/command.h"
#include "tests/support/files.h"
#include "tests/support/status.h"
#include "tests/unit/image/baked_environment_support.h"

namespace candela {
namespace {

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
