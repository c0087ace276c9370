// What the command makes of alpha: straight for .png, the treatments of --alpha, absent pixels, and exposures
// that a limit holds.
#include <gtest/gtest.h>
#include <half.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <functional>

#include "client/image/image.h"
#include "tests/cli/command.h"
#include "tests/cli/images.h"
#include "tests/support/daemon.h"
#include "tests/support/files.h"
#include "tests/support/status.h"

namespace candela {
namespace {

using Pixel = std::array<float, 4>;

void write_exr_of(const std::string& path, const std::function<Pixel(uint32_t x, uint32_t y)>& pixel) {
  Image image = *make_image(64, 48, ImageFormat::kRgba16f);
  std::byte* to = image.pixels.data();
  for (uint32_t y = 0; y < image.height; ++y) {
    for (uint32_t x = 0; x < image.width; ++x, to += 4 * sizeof(half)) {
      const Pixel p = pixel(x, y);
      const half halves[] = {half(p[0]), half(p[1]), half(p[2]), half(p[3])};
      std::memcpy(to, halves, sizeof halves);
    }
  }
  image.has_alpha = true;
  ASSERT_OK_AND_ASSIGN(const auto notes, write_image(path, image));
}

// Grey 0.5 whose edge falls from alpha 1 to 0 over 32 columns; nothing on either side of them.
Pixel soft_edge(uint32_t x, uint32_t) {
  const float a = std::clamp((48.0f - static_cast<float>(x)) / 32.0f, 0.0f, 1.0f);
  return {0.5f * a, 0.5f * a, 0.5f * a, a};
}

class AlphaCommand : public ::testing::Test {
 protected:
  void SetUp() override { write_exr_of(in_, soft_edge); }

  nlohmann::json render(const std::string& out, std::vector<std::string> options = {}) {
    options.insert(options.begin(), {"render", in_, folder_.path(out)});
    return candela_json(options);
  }
  static bool plan_has(const nlohmann::json& frame, const std::string& words) {
    return frame.at("plan").dump().find(words) != std::string::npos;
  }
  // Components of pixel (x, 0) of an .exr that was written.
  Pixel pixel(const std::string& name, uint32_t x) {
    const absl::StatusOr<Image> image = read_image(folder_.path(name));
    if (!image.ok()) return {NAN, NAN, NAN, NAN};
    half halves[4];
    std::memcpy(halves, image->pixels.data() + size_t{x} * sizeof halves, sizeof halves);
    return {halves[0], halves[1], halves[2], halves[3]};
  }

  const TemporaryFolder folder_;
  const std::string in_ = folder_.path("in.exr");
};

// Over white, straight alpha rounds as well as colour does.
TEST_F(AlphaCommand, RoundingOfStraightAlphaCounts) {
  const std::vector<std::string> promise = {"--max-error", "0.5"};
  EXPECT_EQ(render("a.png", promise).at("error_parts").at("rounding"), 1.0);
  EXPECT_EQ(render("b.png", {"--max-error", "0.5", "--alpha", "ignore"}).at("error_parts").at("rounding"),
            0.5);
  EXPECT_EQ(render("c.exr", promise).at("error_parts").at("rounding"), 255.0 / 4096);
}

TEST_F(AlphaCommand, PngIsStraightAndExrIsAssociated) {
  EXPECT_TRUE(plan_has(render("a.png"), "with straight alpha"));
  EXPECT_TRUE(png_facts(folder_.path("a.png")).alpha);
  EXPECT_TRUE(plan_has(render("a.exr"), "with associated alpha"));
  EXPECT_TRUE(plan_has(render("a.jpg"), "with associated alpha"));
  EXPECT_TRUE(plan_has(render("b.png", {"--alpha", "associated"}), "with associated alpha"));
  for (const std::vector<std::string>& options : std::vector<std::vector<std::string>>{
           {"--alpha", "over"}, {"--background", "0.2,0.4,3"}, {"--alpha", "ignore"}}) {
    render("c.png", options);
    EXPECT_FALSE(png_facts(folder_.path("c.png")).alpha) << options[0];
  }
}

TEST_F(AlphaCommand, ASoftEdgeKeepsItsColour) {
  render("a.exr", {"--alpha", "straight", "--exposure", "0", "--curve", "linear"});
  for (uint32_t x = 0; x < 48; ++x) {
    EXPECT_NEAR(pixel("a.exr", x)[0], 0.5f, 1e-3f) << x;
    EXPECT_NEAR(pixel("a.exr", x)[3], soft_edge(x, 0)[3], 1e-3f) << x;
  }
  EXPECT_EQ(pixel("a.exr", 60), (Pixel{0, 0, 0, 0}));
}

TEST_F(AlphaCommand, OverIsCompositedInSceneLight) {
  render("a.exr", {"--background", "0.25,0.5,1", "--exposure", "0", "--curve", "linear"});
  const float a = soft_edge(32, 0)[3];
  const Pixel seen = pixel("a.exr", 32);
  for (size_t k = 0; k < 3; ++k) EXPECT_NEAR(seen[k], 0.5f * a + (1 - a) * std::ldexp(0.25f, int(k)), 1e-3f);
  EXPECT_EQ(seen[3], 1);
}

TEST_F(AlphaCommand, AnObjectOnNothingIsExposedAsTheObject) {
  // 49 of 64 columns have light or alpha.
  const nlohmann::json frame = render("a.png");
  EXPECT_EQ(frame.at("absent_pixels"), 16 * 48);
  EXPECT_LT(frame.at("exposure").get<double>(), 2.0);
  EXPECT_EQ(candela_json({"meter", in_}).at("exposure"), frame.at("exposure"));
  const nlohmann::json ignored = render("b.png", {"--alpha", "ignore"});
  EXPECT_EQ(ignored.at("absent_pixels"), 0);
  EXPECT_GT(ignored.at("exposure").get<double>(), 3 * frame.at("exposure").get<double>());
  EXPECT_EQ(candela_json({"meter", in_, "--alpha", "ignore"}).at("exposure"), ignored.at("exposure"));
}

TEST_F(AlphaCommand, AnEmptyAlphaIsIgnoredAndSaid) {
  write_exr_of(in_, [](uint32_t x, uint32_t) -> Pixel {
    return {0.01f * static_cast<float>(x), 0.2f, 0, 0};
  });
  const Outcome outcome = candela({"render", in_, folder_.path("a.png")});
  EXPECT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_TRUE(says(outcome.err, "note: alpha ignored: it is 0 everywhere"));
  EXPECT_FALSE(png_facts(folder_.path("a.png")).alpha);
  ASSERT_EQ(candela({"stream", in_, folder_.path("%04d.png"), "-q"}).code, 0);
  EXPECT_FALSE(png_facts(folder_.path("0000.png")).alpha);
  EXPECT_TRUE(
      says(candela({"render", in_, folder_.path("a.png"), "--alpha", "associated"}).err, "alpha ignored"));
  render("b.png", {"--alpha", "straight"});
  EXPECT_TRUE(png_facts(folder_.path("b.png")).alpha);
}

// Light so faint that every code of its alpha rounds to 0.
Pixel faint(uint32_t, uint32_t) { return {0.0005f, 0.0003f, 0.0002f, 0.0015f}; }

TEST_F(AlphaCommand, FaintAlphaIsKeptAlthoughItsCodesAreAllZero) {
  write_exr_of(in_, faint);
  const ListeningDaemon daemon;
  ASSERT_NE(daemon.address(), "");
  for (const std::vector<std::string>& options : std::vector<std::vector<std::string>>{
           {}, {"--alpha", "straight"}, {"--alpha", "associated"}, {"--server", daemon.address()}}) {
    std::vector<std::string> arguments =
        with({"render", in_, folder_.path("a.png"), "--exposure=0"}, options);
    const Outcome outcome = candela(arguments);
    ASSERT_EQ(outcome.code, 0) << outcome.err;
    EXPECT_FALSE(says(outcome.err, "alpha"));
    EXPECT_TRUE(png_facts(folder_.path("a.png")).alpha) << (options.empty() ? "" : options[1]);
    arguments[1] = in_;
    arguments[0] = "stream";
    arguments[2] = folder_.path("s%04d.png");
    arguments.insert(arguments.end(), {"--encoding", "png", "-q"});
    ASSERT_EQ(candela(arguments).code, 0);
    EXPECT_TRUE(png_facts(folder_.path("s0000.png")).alpha) << (options.empty() ? "" : options[1]);
  }
}

TEST_F(AlphaCommand, AFadeInHasAlphaInEveryFrame) {
  const std::vector<float> steps = {0.0f, 0.0001f, 0.0015f, 0.004f, 0.25f, 1.0f};
  std::filesystem::create_directory(folder_.path("fade"));
  for (size_t i = 0; i < steps.size(); ++i) {
    write_exr_of(folder_.path("fade/" + std::to_string(i) + ".exr"),
                 [a = steps[i]](uint32_t, uint32_t) -> Pixel {
                   return {0.5f * a, 0.3f * a, 0.2f * a, a};
                 });
  }
  const std::vector<std::string> fade{"stream", folder_.path("fade"), folder_.path("out%d.png"),
                                      "--exposure=0", "-q"};
  for (const std::vector<std::string>& options :
       std::vector<std::vector<std::string>>{{},
                                             {"--encoding", "png"},
                                             {"--dither"},
                                             {"--dither", "--encoding", "png"},
                                             {"--alpha", "associated"}}) {
    std::vector<std::string> arguments = fade;
    arguments.insert(arguments.end(), options.begin(), options.end());
    const Outcome outcome = candela(arguments);
    ASSERT_EQ(outcome.code, 0) << outcome.err;
    // The server knows only that the last frame's alpha is 1 everywhere, which needs no channel.
    for (size_t i = 0; i + 1 < steps.size(); ++i) {
      const std::string out = folder_.path("out" + std::to_string(i) + ".png");
      EXPECT_TRUE(png_facts(out).alpha) << i << " " << (options.empty() ? "" : options[0]);
      std::filesystem::remove(out);
    }
  }
}

TEST_F(AlphaCommand, AnAbsentFrameIsTransparentUnderDither) {
  write_exr_of(in_, [](uint32_t, uint32_t) -> Pixel { return {0, 0, 0, 0}; });
  for (const std::vector<std::string>& options :
       std::vector<std::vector<std::string>>{{}, {"--alpha", "straight"}, {"--alpha", "associated"}}) {
    std::vector<std::string> arguments =
        with({"render", in_, folder_.path("a.png"), "--dither", "-q"}, options);
    ASSERT_EQ(candela(arguments).code, 0);
    EXPECT_TRUE(png_facts(folder_.path("a.png")).alpha);
  }
}

// A sign or a NaN gives no alpha, and no light either.
TEST_F(AlphaCommand, AnAlphaOfZeroOrLessIsEmptyOnlyIfThereIsLight) {
  for (const float none : {0.0f, -0.0f, -0.25f, NAN}) {
    write_exr_of(in_, [none](uint32_t x, uint32_t) -> Pixel { return {0, x == 63 ? 0.2f : 0.0f, 0, none}; });
    const Outcome lit = candela({"render", in_, folder_.path("a.png")});
    EXPECT_TRUE(says(lit.err, "alpha ignored")) << none;
    EXPECT_FALSE(png_facts(folder_.path("a.png")).alpha) << none;
    write_exr_of(in_, [none](uint32_t, uint32_t) -> Pixel { return {-0.0f, NAN, 0, none}; });
    const Outcome dark = candela({"render", in_, folder_.path("a.png")});
    EXPECT_FALSE(says(dark.err, "alpha ignored")) << none;
    EXPECT_TRUE(png_facts(folder_.path("a.png")).alpha) << none;
  }
}

TEST_F(AlphaCommand, StreamWritesStraightPngWhoeverEncodes) {
  for (const std::string encoding : {"raw", "png"}) {
    ASSERT_EQ(
        candela({"stream", in_, folder_.path(encoding + "%04d.png"), "--encoding", encoding, "-q"}).code, 0);
    EXPECT_TRUE(png_facts(folder_.path(encoding + "0000.png")).alpha) << encoding;
  }
}

TEST_F(AlphaCommand, AnExposureThatALimitHoldsIsSaid) {
  const nlohmann::json free = render("a.png");
  EXPECT_EQ(free.at("target_before_limits"), free.at("target"));
  const double wanted = free.at("target").get<double>();
  for (const std::vector<std::string>& limit :
       std::vector<std::vector<std::string>>{{"--max-exposure", "0.125"}, {"--min-exposure", "32"}}) {
    const nlohmann::json held = render("b.png", limit);
    EXPECT_EQ(held.at("target"), std::stod(limit[1]));
    EXPECT_EQ(held.at("target_before_limits").get<double>(), wanted);
    const std::string words = "exposure held at " + limit[0] + " " + limit[1] + "; it would have been ";
    for (const std::vector<std::string>& command :
         std::vector<std::vector<std::string>>{{"render", in_, folder_.path("c.png")}, {"meter", in_}}) {
      std::vector<std::string> arguments = command;
      arguments.insert(arguments.end(), limit.begin(), limit.end());
      const Outcome outcome = candela(arguments);
      EXPECT_TRUE(says(outcome.out + outcome.err, words));
    }
  }
}

TEST_F(AlphaCommand, WrongOptionsAreRefused) {
  for (const auto& [options, words] : std::vector<std::pair<std::vector<std::string>, std::string>>{
           {{"--alpha", "premultiplied"}, "--alpha"},
           {{"--background", "1,2"}, "--background is \"1,2\"; it must be 3 numbers"},
           {{"--background", "1,2,-1"}, "--background"},
           {{"--background", "1,2,2e9"}, "--background"},
           {{"--alpha", "straight", "--background", "1,2,3"}, "--background needs --alpha over"}}) {
    const Outcome outcome = candela(with({"render", in_, folder_.path("a.png")}, options));
    EXPECT_EQ(outcome.code, 2) << outcome.err;
    EXPECT_TRUE(says(outcome.err, words));
  }
}

// A letterboxed data window: everything outside of it is absent, also in a file without an alpha channel.
TEST_F(AlphaCommand, OutsideTheDataWindowNothingIsMetered) {
  if (data_folder().empty()) GTEST_SKIP() << "no test data: set CANDELA_DATA to its folder";
  const auto frame = [&](const std::string& name) {
    return candela_json({"meter", data_folder() + "/display_window/" + name});
  };
  EXPECT_EQ(frame("t01.exr").at("absent_pixels"), 0);
  const nlohmann::json boxed = frame("t15.exr");  // 400x300 within 481x371
  EXPECT_EQ(boxed.at("absent_pixels"), 481 * 371 - 400 * 300);
  EXPECT_EQ(boxed.at("mean_log2_luminance"), frame("t01.exr").at("mean_log2_luminance"));
  const nlohmann::json whole =
      candela_json({"meter", data_folder() + "/display_window/t15.exr", "--alpha", "ignore"});
  EXPECT_EQ(whole.at("absent_pixels"), 0);
  EXPECT_LT(whole.at("mean_log2_luminance"), boxed.at("mean_log2_luminance"));  // black is metered
  EXPECT_EQ(frame("t09.exr").at("mean_log2_luminance"), std::log2(0.18));       // the windows do not meet
}

// Both pictures are dark nearly everywhere. The first is transparent there and is exposed for its candle; a
// limit holds the other's exposure.
TEST_F(AlphaCommand, PublishedFramesWithAlphaAreAccurate) {
  if (data_folder().empty()) GTEST_SKIP() << "no test data: set CANDELA_DATA to its folder";
  for (const auto& [name, exposure] :
       {std::pair{"exr/CandleGlass.exr", 16.34}, {"exr/StillLife.exr", 64.0}}) {
    const std::string path = data_folder() + "/" + name;
    const nlohmann::json frame = candela_json({"render", path, folder_.path("a.png"), "--verify"});
    EXPECT_NEAR(frame.at("exposure").get<double>(), exposure, 0.005) << name;
    EXPECT_GE(frame.at("target_before_limits"), frame.at("exposure")) << name;
    EXPECT_LE(frame.at("verify").at("max_error_codes").get<double>(), 0.5) << name;
    EXPECT_TRUE(png_facts(folder_.path("a.png")).alpha) << name;
  }
}

}  // namespace
}  // namespace candela
