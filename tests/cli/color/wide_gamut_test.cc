// Files with light outside of Rec.709, from the file to the picture.
#include "tests/support/wide_gamut.h"

#include <gtest/gtest.h>
#include <half.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <string>
#include <vector>

#include "client/image/image.h"
#include "server/render/color/aces.h"
#include "server/render/color/primaries.h"
#include "tests/cli/command.h"
#include "tests/support/files.h"
#include "tests/support/status.h"

namespace candela {
namespace {

using testing::Color;

constexpr uint32_t kWidth = 100;
constexpr uint32_t kHeight = 60;

class WideGamutFile : public ::testing::Test {
 protected:
  WideGamutFile() {
    // ACEScg, as halves.
    Image image = *make_image(kWidth, kHeight, ImageFormat::kRgba16f);
    const std::array<float, 9> to_rec709 = **matrix_to_rec709(chromaticities(v1::PRIMARIES_ACES_AP1));
    std::byte* to = image.pixels.data();
    for (const Color& c : testing::saturated_inside_ap1(v1::PRIMARIES_ACES_AP1, kWidth * kHeight).own) {
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
  EXPECT_GT(linear["gamut_cut_components"], kWidth * kHeight * 3 / 10);
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

}  // namespace
}  // namespace candela
