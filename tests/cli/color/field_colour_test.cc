// Files of kinds that people reported to other programs: what they say about their colours.
#include <gtest/gtest.h>

#include <array>
#include <cstring>

#include "tests/cli/command.h"
#include "tests/cli/images.h"
#include "tests/support/files.h"

namespace candela {
namespace {

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

}  // namespace
}  // namespace candela
