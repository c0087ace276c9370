// PNG and JPEG files that the server makes are those that the command makes: pixels, alpha and pixel aspect.
#include <gtest/gtest.h>

#include <filesystem>

#include "client/image/image.h"
#include "tests/cli/command.h"
#include "tests/cli/images.h"
#include "tests/support/files.h"
#include "tests/support/status.h"

namespace candela {
namespace {

class Encoded : public ::testing::Test {
 protected:
  // Streams the folder "in" twice: encoded by the command, and by the server.
  void expect_the_same(const std::string& encoding, std::vector<std::string> options) {
    const std::string own = folder_.path("own"), made = folder_.path("made");
    const std::string name = encoding == "png" ? "/%04d.png" : "/%04d.jpg";
    options.insert(options.begin(), {"stream", folder_.path("in"), own + name, "-q"});
    ASSERT_EQ(candela(options).code, 0);
    options[2] = made + name;
    options.insert(options.end(), {"--encoding", encoding});
    ASSERT_EQ(candela(options).code, 0);
    const std::string file = encoding == "png" ? "/0000.png" : "/0000.jpg";
    EXPECT_FALSE(read_file(own + file).empty());
    EXPECT_TRUE(read_file(own + file) == read_file(made + file)) << encoding;
    if (encoding == "png") facts_ = png_facts(made + file);
  }

  // An image with this alpha everywhere, lit or black, and pixels twice as wide as high.
  void write_flat(float alpha, bool lit) {
    ASSERT_OK_AND_ASSIGN(Image image, make_image(24, 16, ImageFormat::kRgba32f));
    auto* component = reinterpret_cast<float*>(image.pixels.data());
    for (uint32_t i = 0; i < 24 * 16; ++i, component += 4) {
      for (int k = 0; k < 3; ++k) component[k] = lit ? 0.1f * static_cast<float>(k + 1) : 0;
      component[3] = alpha;
    }
    image.has_alpha = true;
    image.pixel_aspect = 2;
    ASSERT_EQ(candela({"sample", folder_.path("in/x.exr"), "--size", "8x8", "-q"}).code, 0);  // the folder
    std::filesystem::remove(folder_.path("in/x.exr"));
    ASSERT_OK(write_image(folder_.path("in/0000.exr"), image));
  }

  const TemporaryFolder folder_;
  PngFacts facts_;
};

TEST_F(Encoded, PixelAspectAndAlphaAreTheSame) {
  ASSERT_EQ(candela({"sample", folder_.path("in/x.exr"), "--size", "8x8", "-q"}).code, 0);
  std::filesystem::remove(folder_.path("in/x.exr"));
  write_small_exr(folder_.path("in/0000.exr"), true);
  for (const std::vector<std::string>& options : std::vector<std::vector<std::string>>{
           {}, {"--bits", "16"}, {"--alpha", "associated"}, {"--transfer", "gamma22"}}) {
    expect_the_same("png", options);
    EXPECT_TRUE(facts_.alpha);
    EXPECT_NEAR(facts_.pixel_aspect, 2, 1e-3);
  }
  expect_the_same("png", {"--alpha", "over"});
  EXPECT_FALSE(facts_.alpha);
  expect_the_same("jpeg", {});
  expect_the_same("jpeg", {"--quality", "50"});
}

TEST_F(Encoded, AConstantAlphaIsKeptUnlessItSaysNothing) {
  write_flat(0.5f, true);
  expect_the_same("png", {"--alpha", "associated"});
  EXPECT_TRUE(facts_.alpha);
  write_flat(0, true);
  expect_the_same("png", {"--alpha", "associated"});
  EXPECT_FALSE(facts_.alpha);
  write_flat(0, false);
  expect_the_same("png", {"--alpha", "associated"});
  EXPECT_TRUE(facts_.alpha);
}

}  // namespace
}  // namespace candela
