// Runs the command on every file of the shared test data: good files become pictures, and damaged ones are
// refused by name.
#include <gtest/gtest.h>

#include <algorithm>

#include "tests/cli/command.h"
#include "tests/cli/images.h"
#include "tests/support/files.h"
#include "tests/support/status.h"

namespace candela {
namespace {

class Data : public ::testing::Test {
 protected:
  void SetUp() override {
    if (data_folder().empty()) GTEST_SKIP() << "no test data: set CANDELA_DATA to its folder";
  }

  void expect_refused(const std::string& path, const std::string& words) {
    const Outcome outcome = candela({"render", path, folder_.path("bad.png")});
    EXPECT_EQ(outcome.code, 3) << path << ": " << outcome.err;
    EXPECT_EQ(outcome.err.find("candela: error: " + path + ": "), 0u) << outcome.err;
    EXPECT_EQ(std::count(outcome.err.begin(), outcome.err.end(), '\n'), 1) << outcome.err;
    EXPECT_TRUE(says(outcome.err, words));
  }

  TemporaryFolder folder_;
};

class EveryGoodFile : public Data, public ::testing::WithParamInterface<const char*> {};

TEST_P(EveryGoodFile, BecomesAPictureOfItsSizeWithinTheBounds) {
  for (const std::string& path : data_files(GetParam())) {
    if (path.ends_with("Trunks_deep.exr")) continue;
    const std::string png = folder_.path("out.png");
    const nlohmann::json frame = candela_json({"render", path, png, "--verify"});
    ASSERT_TRUE(frame.is_object()) << path;
    const PngFacts facts = png_facts(png);
    EXPECT_EQ(frame.at("size").at("width"), facts.width) << path;
    EXPECT_EQ(frame.at("size").at("height"), facts.height) << path;
    EXPECT_LE(frame.at("verify").at("max_error_codes").get<double>(), 0.5) << path;
    EXPECT_LE(frame.at("verify").at("p999_error_codes").get<double>(), 0.05) << path;
  }
}

INSTANTIATE_TEST_SUITE_P(In, EveryGoodFile,
                         ::testing::Values("exr", "chromaticities", "display_window", "compression", "hdri",
                                           "radiance", "aces", "sequence/beachball_multipart",
                                           "sequence/pan_apartment"),
                         [](const auto& folder) {
                           std::string name = folder.param;
                           std::replace(name.begin(), name.end(), '/', '_');
                           return name;
                         });

TEST_F(Data, EveryDamagedFileIsRefusedByName) {
  for (const std::string& path : data_files("bad")) {
    if (path.ends_with("21_type_attribute_lies.exr")) continue;  // a whole picture, on which readers differ
    expect_refused(path, "");
  }
  EXPECT_TRUE(folder_.list().empty());
}

TEST_F(Data, ADeepImageIsRefusedByName) {
  expect_refused(data_folder() + "/exr/Trunks_deep.exr", "deep image");
}

TEST_F(Data, BadPixelsAreCounted) {
  const nlohmann::json frame =
      candela_json({"render", data_folder() + "/exr/BrightRingsNanInf.exr", folder_.path("out.png")});
  EXPECT_EQ(frame.at("bad_values"), nlohmann::json({{"nan", 6}, {"inf", 12}, {"negative", 6}}));
}

TEST_F(Data, PixelAspectReachesThePng) {
  ASSERT_EQ(candela({"render", data_folder() + "/display_window/t15.exr", folder_.path("out.png")}).code, 0);
  EXPECT_NEAR(png_facts(folder_.path("out.png")).pixel_aspect, 1.5, 1e-3);
}

}  // namespace
}  // namespace candela
