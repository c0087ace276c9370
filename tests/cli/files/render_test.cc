// The files that `candela render` and `candela sample` write.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "absl/strings/str_split.h"
#include "client/image/image.h"
#include "tests/cli/command.h"
#include "tests/cli/images.h"
#include "tests/support/files.h"
#include "tests/support/status.h"

namespace candela {
namespace {

class Render : public ::testing::Test {
 protected:
  void SetUp() override { write_small_exr(in_); }

  // The bytes of the picture that is rendered with these additional options.
  std::string picture(std::vector<std::string> options, const std::string& name = "out.png") {
    options.insert(options.begin(), {"render", in_, folder_.path(name), "-q"});
    const Outcome outcome = candela(options);
    EXPECT_EQ(outcome.code, 0) << outcome.err;
    EXPECT_EQ(outcome.err, "");
    return read_file(folder_.path(name));
  }

  const TemporaryFolder folder_;
  const std::string in_ = folder_.path("in.exr");
};

TEST_F(Render, TheSampleSceneBecomesAPngOfItsSize) {
  const std::string scene = folder_.path("scene.exr"), png = folder_.path("scene.png");
  ASSERT_EQ(candela({"sample", scene, "--size", "321x179"}).code, 0);
  const Outcome outcome = candela({"render", scene, png, "-v"});
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  const PngFacts facts = png_facts(png);
  EXPECT_EQ(facts.width, 321u);
  EXPECT_EQ(facts.height, 179u);
  EXPECT_EQ(facts.bits, 8);
  EXPECT_FALSE(facts.alpha);
  for (const char* word : {"321x179", "EV", "ingest", "resolve", " ms", "scene.png"}) {
    EXPECT_TRUE(says(outcome.out, word));
  }
}

TEST_F(Render, TheSampleSceneIsTheSameEveryTimeInBothFormats) {
  for (const char* name : {"a.pfm", "b.pfm", "c.exr", "d.exr"}) {
    ASSERT_EQ(candela({"sample", folder_.path(name), "--size", "33x21", "-q"}).code, 0) << name;
  }
  EXPECT_TRUE(read_file(folder_.path("a.pfm")) == read_file(folder_.path("b.pfm")));
  EXPECT_TRUE(read_file(folder_.path("c.exr")) == read_file(folder_.path("d.exr")));
}

TEST_F(Render, TwoRunsGiveTheSameBits) { EXPECT_TRUE(picture({}, "a.png") == picture({}, "b.png")); }

TEST_F(Render, EveryKindOfOutputIsWritten) {
  picture({"--bits", "16"}, "deep.png");
  EXPECT_EQ(png_facts(folder_.path("deep.png")).bits, 16);
  EXPECT_EQ(picture({}, "a.jpg").substr(0, 2), "\xff\xd8");
  EXPECT_LT(picture({"--quality", "5"}, "small.jpeg").size(),
            picture({"--quality", "95"}, "large.jpg").size());
  const std::string tiff("II*\0", 4);
  EXPECT_EQ(picture({}, "a.tif").substr(0, 4), tiff);
  EXPECT_EQ(picture({"--bits", "16"}, "deep.tiff").substr(0, 4), tiff);
  for (const char* name : {"a.exr", "a.pfm"}) {
    picture({}, name);
    ASSERT_OK_AND_ASSIGN(const Image image, read_image(folder_.path(name)));
    EXPECT_EQ(image.width, 31u);
    EXPECT_EQ(image.height, 17u);
  }
}

TEST_F(Render, AlphaAndPixelAspectReachPngAndExr) {
  write_small_exr(in_, true);
  for (const char* bits : {"8", "16"}) {
    picture({"--bits", bits}, "out.png");
    EXPECT_TRUE(png_facts(folder_.path("out.png")).alpha);
    EXPECT_NEAR(png_facts(folder_.path("out.png")).pixel_aspect, 2, 1e-3);
  }
  picture({}, "out.exr");
  ASSERT_OK_AND_ASSIGN(const Image image, read_image(folder_.path("out.exr")));
  EXPECT_TRUE(image.has_alpha);
  EXPECT_EQ(image.pixel_aspect, 2);
  const absl::StatusOr<Image> input = read_image(in_);
  for (size_t i = 6; i < image.bytes(); i += 8) {  // the alpha half
    ASSERT_EQ(image.pixels.data()[i], input->pixels.data()[i]);
    ASSERT_EQ(image.pixels.data()[i + 1], input->pixels.data()[i + 1]);
  }
}

TEST_F(Render, EveryOptionChangesThePicture) {
  const std::string plain = picture({});
  for (const std::vector<std::string>& options : std::vector<std::vector<std::string>>{
           {"--exposure", "-2"},
           {"--compensation", "1"},
           {"--key", "0.5"},
           {"--min-exposure", "50"},
           {"--max-exposure", "0.1"},
           {"--bloom-intensity", "1"},
           {"--bloom-threshold", "0.1"},
           {"--bloom-softness", "0", "--bloom-threshold", "0.5", "--bloom-intensity", "1"},
           {"--bloom-levels", "1", "--bloom-intensity", "1"},
           {"--bloom-firefly", "off", "--bloom-intensity", "1"},
           {"--curve", "linear"},
           {"--curve", "reinhard"},
           {"--curve", "aces-narkowicz"},
           {"--prescale", "0.5"},
           {"--transfer", "gamma22"},
           {"--transfer", "linear"}}) {
    EXPECT_TRUE(picture(options) != plain) << ::testing::PrintToString(options);
  }
}

TEST_F(Render, TheDefaultsSpeltOutChangeNothing) {
  const std::string spelt_out =
      "--exposure auto --compensation 0 --key 0.18 --min-exposure 0.015625 --max-exposure 64 "
      "--bloom-intensity 0.05 --bloom-threshold 1 --bloom-softness 0.5 --bloom-levels 5 --bloom-firefly on "
      "--curve aces-hill --prescale 1 --transfer srgb --tier standard --bad-values scrub --bits 8";
  EXPECT_TRUE(picture(absl::StrSplit(spelt_out, ' ')) == picture({}));
}

TEST_F(Render, TheLastOfARepeatedOptionCounts) {
  const std::string repeated =
      picture({"--curve", "linear", "--exposure", "3", "--curve", "reinhard", "--exposure=auto"});
  EXPECT_TRUE(repeated == picture({"--curve", "reinhard"}));
}

#ifndef CANDELA_SANITIZED  // a sanitizer's own memory counts too
TEST_F(Render, AFrameOf4KHalvesStaysUnder600MB) {
  if (data_folder().empty()) GTEST_SKIP() << "no test data: set CANDELA_DATA to its folder";
  constexpr int64_t kLimitKib = 600'000'000 / 1024;
  const std::string frame = data_folder() + "/exr/large_4096x3112.exr";
  for (const std::vector<std::string>& output :
       std::vector<std::vector<std::string>>{{"a.png"}, {"b.png", "--bits", "16"}, {"c.exr"}}) {
    std::vector<std::string> arguments{"render", frame, folder_.path(output[0])};
    arguments.insert(arguments.end(), output.begin() + 1, output.end());
    // Memory varies with the machine's load, because it depends on how many threads work at the same time. So
    // this takes the smallest of three.
    int64_t least_kib = std::numeric_limits<int64_t>::max();
    for (int i = 0; i < 3 && least_kib >= kLimitKib; ++i) {
      const Outcome outcome = candela(arguments);
      EXPECT_EQ(outcome.code, 0) << outcome.err;
      least_kib = std::min<int64_t>(least_kib, outcome.peak_kib);
    }
    EXPECT_LT(least_kib, kLimitKib) << output[0];
  }
}
#endif

}  // namespace
}  // namespace candela
