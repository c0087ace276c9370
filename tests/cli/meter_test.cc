// `candela meter`, beside what `candela render` uses, and the settings of the input that both share.
#include <gtest/gtest.h>

#include <cmath>

#include "tests/cli/command.h"
#include "tests/support/files.h"
#include "tests/support/status.h"

namespace candela {
namespace {

class MeterCommand : public ::testing::Test {
 protected:
  const TemporaryFolder folder_;
};

TEST_F(MeterCommand, SaysWhatRenderUses) {
  const std::string scene = folder_.path("scene.exr");
  ASSERT_EQ(candela({"sample", scene, "--size", "128x96", "-q"}).code, 0);
  for (const std::vector<std::string>& options : std::vector<std::vector<std::string>>{
           {}, {"--percentiles", "20,80", "--weights", "center", "--key", "0.5"}}) {
    std::vector<std::string> meter{"meter", scene}, render{"render", scene, folder_.path("scene.png")};
    meter.insert(meter.end(), options.begin(), options.end());
    render.insert(render.end(), options.begin(), options.end());
    const nlohmann::json metered = candela_json(meter), rendered = candela_json(render);
    for (const char* key :
         {"exposure", "target", "mean_log2_luminance", "min_luminance", "max_luminance", "bad_values"}) {
      EXPECT_EQ(metered.at(key), rendered.at(key)) << key;
    }
    EXPECT_GT(metered.at("histogram").at("bins_per_ev"), 0);
  }
  const Outcome text = candela({"meter", scene});
  ASSERT_EQ(text.code, 0) << text.err;
  for (const char* word : {"128x96", "exposure", "EV", "##", "<- the mean"}) {
    EXPECT_TRUE(says(text.out, word));
  }
  EXPECT_EQ(candela({"meter", folder_.path("none.exr")}).code, 3);
}

TEST_F(MeterCommand, AFileWithAnOptionOfSequencesIsASequenceOfOneFrame) {
  const std::string scene = folder_.path("scene.exr");
  ASSERT_EQ(candela({"sample", scene, "--size", "64x48", "-q"}).code, 0);
  const auto meter = [&scene](const std::vector<std::string>& options) {
    return candela(with({"meter", scene, "-q", "--json", "-"}, options));
  };
  for (const std::vector<std::string>& options :
       std::vector<std::vector<std::string>>{{"--range", "0"},
                                             {"--missing", "skip"},
                                             {"--cut-at", "0"},
                                             {"--fps", "25"},
                                             {"--lookahead", "2"},
                                             {"--detect-cuts"},
                                             {"--frame-timeout", "60"},
                                             {"--skip-bad"},
                                             {"--session", "named"},
                                             {"--save-exposures", folder_.path("shot.json")}}) {
    const Outcome outcome = meter(options);
    EXPECT_EQ(outcome.code, 0) << outcome.err;
    EXPECT_TRUE(says(outcome.out, "{\"summary\":{\"frames\":1,")) << options.front();
  }
  for (const char* option : {"--range", "--cut-at"}) {
    const Outcome refused = meter({option, "7"});
    EXPECT_EQ(refused.code, 3) << option;
    EXPECT_TRUE(says(refused.err, "there is no such frame"));
  }
  EXPECT_FALSE(says(meter({}).out, "summary"));
}

// The bars of a letterbox, in a .pfm: rows of 0 above and below rows of 1 and 4.
TEST_F(MeterCommand, IgnoresTheBarsOfALetterbox) {
  std::string pfm = "Pf\n8 8\n-1.0\n";
  for (int i = 0; i < 64; ++i) {
    const float v = i < 16 || i >= 48 ? 0.0f : i < 32 ? 1.0f : 4.0f;
    pfm.append(reinterpret_cast<const char*>(&v), sizeof v);
  }
  const std::string path = folder_.path("letterbox.pfm");
  write_file(path, pfm);
  const auto mean = [&](const std::vector<std::string>& options) {
    std::vector<std::string> arguments = with({"meter", path}, options);
    return candela_json(arguments).at("mean_log2_luminance").get<double>();
  };
  EXPECT_NEAR(mean({}), 0.5 + 0.5 * std::log2(1e-4), 1e-3);
  EXPECT_NEAR(mean({"--ignore-below", "0.01"}), 1.0, 1e-5);
  EXPECT_NEAR(mean({"--ignore-below", "2"}), 2.0, 1e-5);
  EXPECT_EQ(mean({"--ignore-below", "5"}), std::log2(0.18));
  const Outcome dark = candela({"meter", path, "--ignore-below", "5"});
  EXPECT_TRUE(says(dark.out, "nothing is metered"));
  const Outcome refused = candela({"meter", path, "--ignore-below", "-1"});
  EXPECT_EQ(refused.code, 2);
  EXPECT_TRUE(says(refused.err, "--ignore-below is -1"));
}

// A card in light of 3200 K, in linear Rec.709, rendered as display-linear floats.
TEST_F(MeterCommand, AWhiteBalanceMakesItsLightNeutral) {
  const float card[] = {0.16797f, 0.08661f, 0.03258f};
  std::string pfm = "PF\n1 1\n-1.0\n";
  pfm.append(reinterpret_cast<const char*>(card), sizeof card);
  const std::string in = folder_.path("card.pfm"), out = folder_.path("out.pfm");
  write_file(in, pfm);
  const std::vector<std::string> render{
      "render", in, out, "--exposure", "0", "--curve", "linear", "--bloom-intensity", "0"};
  std::vector<std::string> balanced = render, tinted = render;
  balanced.insert(balanced.end(), {"--white-balance", "3200"});
  tinted.insert(tinted.end(), {"--tint", "0.2"});
  ASSERT_EQ(candela(balanced).code, 0);
  const std::string bytes = read_file(out);
  float rgb[3];
  ASSERT_GE(bytes.size(), sizeof rgb);
  bytes.copy(reinterpret_cast<char*>(rgb), sizeof rgb, bytes.size() - sizeof rgb);
  EXPECT_NEAR(rgb[0] / rgb[1], 1.0, 5e-3);
  EXPECT_NEAR(rgb[2] / rgb[1], 1.0, 5e-3);
  const Outcome refused = candela(tinted);
  EXPECT_EQ(refused.code, 2);
  EXPECT_TRUE(says(refused.err, "--tint is 0.2 and there is no --white-balance"));
}

}  // namespace
}  // namespace candela
