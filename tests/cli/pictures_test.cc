// Pictures from file to file: hard cases, kinds that people have reported, and real ones.
#include <OpenEXR/ImfInputFile.h>
#include <OpenEXR/ImfStandardAttributes.h>
#include <gtest/gtest.h>
#include <half.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <regex>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "client/image/image.h"
#include "tests/cli/command.h"
#include "tests/cli/images.h"
#include "tests/support/files.h"
#include "tests/support/scenes.h"
#include "tests/support/status.h"

namespace candela {
namespace {

constexpr uint32_t kWidth = 67;
constexpr uint32_t kHeight = 35;

std::string pfm(const testing::HardCase& hard) {
  std::string bytes = "PF\n67 35\n-1.0\n";
  for (uint32_t y = kHeight; y-- > 0;) {
    for (uint32_t x = 0; x < kWidth; ++x) {
      const testing::Texel texel = hard.texel(x, y);
      bytes.append(reinterpret_cast<const char*>(texel.data()), 3 * sizeof(float));
    }
  }
  return bytes;
}

// The error of a picture with the tier `tier`, or with the promise `max_error` in its place.
double error_of(const std::string& in, const std::string& out, const std::string& option,
                const std::string& value, const std::string& bloom) {
  const nlohmann::json done =
      candela_json({"render", in, out, option, value, "--bloom-intensity", bloom, "--verify", "-q"});
  EXPECT_TRUE(done.is_object());
  if (!done.is_object()) return 255;
  if (option == "--tier") {
    EXPECT_EQ(done.at("tier"), value);
  }
  EXPECT_TRUE(std::isfinite(done.at("exposure").get<double>()));
  EXPECT_TRUE(done.at("verify").at("max_error_codes").is_number());
  return done.at("verify").at("max_error_codes").get<double>();
}

TEST(HardCases, BecomePicturesWithinThePublishedErrorInEveryTier) {
  const TemporaryFolder folder;
  const std::string out = folder.path("out.png");
  // Draft has no bound where something blooms. Without bloom it is within its transfer's error.
  struct Case {
    std::string tier, bloom;
    double codes;
  };
  const std::vector<Case> cases = {{"draft", "0.05", 255},
                                   {"draft", "0", 0.083 + 4e-4},
                                   {"standard", "0.05", 4e-4},
                                   {"standard", "0", 4e-4},
                                   {"reference", "0.05", 4e-4}};
  for (const testing::HardCase& hard : testing::hard_cases(kWidth, kHeight)) {
    const std::string in = folder.path("in.pfm");
    write_file(in, pfm(hard));
    for (const Case& c : cases) {
      SCOPED_TRACE(hard.name + " " + c.tier + " " + c.bloom);
      EXPECT_LE(error_of(in, out, "--tier", c.tier, c.bloom), c.codes);
    }
    SCOPED_TRACE(hard.name + " within 0.1");
    EXPECT_LE(error_of(in, out, "--max-error", "0.1", "0.05"), 0.1);
  }
}

// The number of the driver's threads does not change the picture.
TEST(HardCases, TheNumberOfThreadsChangesNoBit) {
  const TemporaryFolder folder;
  const std::string in = folder.path("in.exr");
  ASSERT_EQ(candela({"sample", in, "--size", "333x217", "-q"}).code, 0);
  std::string first;
  for (const char* threads : {"1", "2", "7"}) {
    setenv("LP_NUM_THREADS", threads, 1);
    const std::string out = folder.path("out.png");
    EXPECT_EQ(
        candela({"render", in, out, "-q", "--bits", "16", "--percentiles", "10,90", "--weights", "center"})
            .code,
        0);
    unsetenv("LP_NUM_THREADS");
    if (first.empty()) first = read_file(out);
    EXPECT_TRUE(read_file(out) == first) << threads << " threads";
  }
}

// Files of kinds that people reported to other programs: which picture is read, what is no damage, and
// headers.

class FieldPicture : public ::testing::Test {
 protected:
  void SetUp() override {
    if (data_folder().empty() || !std::filesystem::exists(file("README.md"))) {
      GTEST_SKIP() << "no test data: set CANDELA_DATA to a folder that has field/";
    }
  }

  static std::string file(const std::string& name) { return data_folder() + "/field/" + name; }

  // The linear picture of a file, and what the command says about it.
  Image picture(const std::string& name, std::vector<std::string> options = {}) {
    const std::string out = folder_.path("out.pfm");
    std::vector<std::string> words =
        with({"render", file(name), out, "--curve", "linear", "--exposure", "0", "--bloom-intensity", "0"},
             options);
    said_ = candela(words);
    EXPECT_EQ(said_.code, 0) << said_.err;
    absl::StatusOr<Image> image = read_image(out);
    EXPECT_OK(image) << name;
    return image.ok() ? *std::move(image) : Image{};
  }

  // The pixel's red, green and blue.
  static std::array<float, 3> pixel(const Image& image, uint32_t x, uint32_t y) {
    std::array<float, 3> rgb{};
    if (x >= image.width || y >= image.height) return rgb;
    const std::byte* at =
        image.pixels.data() + y * image.row_bytes() + size_t{x} * bytes_per_pixel(image.format);
    std::array<half, 3> halves;
    if (image.format == ImageFormat::kRgba32f) {
      std::memcpy(rgb.data(), at, sizeof rgb);
    } else {
      std::memcpy(halves.data(), at, sizeof halves);
      for (size_t c = 0; c < 3; ++c) rgb[c] = halves[c];
    }
    return rgb;
  }

  void expect_c(const std::string& name, const std::vector<std::string>& options = {}, float factor = 1) {
    const std::array<float, 3> rgb = pixel(picture(name, options), 0, 0);
    EXPECT_NEAR(rgb[0], 0.5f * factor, 1e-3) << name;
    EXPECT_NEAR(rgb[1], 0.25f * factor, 1e-3) << name;
    EXPECT_NEAR(rgb[2], 0.125f * factor, 1e-3) << name;
  }

  void expect_note(const std::string& words) { EXPECT_TRUE(says(said_.err, words)); }

  // The one line of an error.
  std::string error(const std::string& name, std::vector<std::string> options = {}) {
    std::vector<std::string> words = with({"render", file(name), folder_.path("out.png")}, options);
    said_ = candela(words);
    EXPECT_NE(said_.code, 0) << name;
    EXPECT_EQ(std::count(said_.err.begin(), said_.err.end(), '\n'), 1) << said_.err;
    return said_.err;
  }

  TemporaryFolder folder_;
  Outcome said_;
};

TEST_F(FieldPicture, ChannelsHaveNamesInAnyCaseAndInFull) {
  expect_c("L01_lower.exr");
  expect_c("L26_upper_lower_mix.exr");
  expect_c("L02_fullnames.exr");
  expect_note("layer rgba is shown; there is also --layer depth");
}

TEST_F(FieldPicture, ThePictureIsTheOneWhoseNameMeansIt) {
  expect_c("M02_rgba_main.exr");
  expect_note("rgba_main");
  expect_c("L05_blender_aov.exr");
  expect_note("layer Main.Combined is shown; there are also --layer Main.AOV");
  expect_c("L06_ao_rgba.exr");
  expect_note("layer rgba is shown; there are also --layer AO");
  expect_c("L07_houdini_parts.exr");
  expect_note("part 3 of 3, C, is shown; there are also --part N, --part albedo");
}

TEST_F(FieldPicture, NamesAreUtf8AndCanBePassedBack) {
  expect_c("L24_utf8_layer.exr");
  expect_note("layer Gl\xc3\xbchen is shown");
  expect_c("L24_utf8_layer.exr", {"--layer", "Gl\xc3\xbchen"});
  const nlohmann::json facts = candela_json({"info", file("L24_utf8_layer.exr")});
  const std::string layer = facts.at("parts").at(0).at("layers").at(0);
  EXPECT_EQ(layer, "Gl\xc3\xbchen");
}

// Reads what messages advise.
TEST_F(FieldPicture, EveryChoiceThatAMessageAdvisesWorks) {
  int advised = 0;
  for (const std::string& path : data_files("field")) {
    if (absl::StrContains(path, "/S0")) continue;
    const std::string out = folder_.path("told.png");
    const Outcome told = candela({"render", path, out});
    const Outcome wrong = candela({"render", path, out, "--layer", "no such layer"});
    const std::string words = told.err + wrong.err;
    std::vector<PictureChoice> choices;
    const std::regex option("--(part|layer|incomplete) ([^ ,;\n]+)");
    for (auto i = std::sregex_iterator(words.begin(), words.end(), option); i != std::sregex_iterator();
         ++i) {
      PictureChoice& choice = choices.emplace_back();
      if ((*i)[1] == "part") choice.part = (*i)[2];
      if ((*i)[1] == "layer") choice.layer = (*i)[2];
      if ((*i)[1] == "incomplete") choice.fills_gaps = (*i)[2] == "fill";
    }
    // "there are: A, B" lists layers and channels.
    const size_t list = wrong.err.find("there are: ");
    const std::string names =
        list == std::string::npos ? "" : wrong.err.substr(list + 11, wrong.err.find('\n', list) - list - 11);
    const std::regex one("([^,]+)(, |$)");
    for (auto i = std::sregex_iterator(names.begin(), names.end(), one); i != std::sregex_iterator(); ++i) {
      if ((*i)[1] != "...") choices.push_back({.layer = (*i)[1]});
    }
    // A chunk of K02 takes seconds.
    if (absl::StrContains(path, "K02")) choices.resize(std::min<size_t>(choices.size(), 2));
    const bool fills = absl::StrContains(told.err, "--incomplete fill");
    for (PictureChoice& choice : choices) {
      choice.fills_gaps = choice.fills_gaps || fills;
      EXPECT_OK(read_image(path, {.max_chunk_bytes = 1u << 30}, choice))
          << choice.part << " " << choice.layer;
      ++advised;
    }
  }
  EXPECT_GT(advised, 40);
}

TEST_F(FieldPicture, AChunkMayTakeAShareOfTheMemory) {
  const Image image = picture("K02_4k_dwab_103f.exr", {"--max-chunk-mib", "400"});
  EXPECT_EQ(image.width, 3840u);
  EXPECT_NEAR(pixel(image, 0, 0)[0], 0.25f, 1e-3);
  EXPECT_LT(said_.peak_kib, 3 << 20);
  EXPECT_TRUE(
      says(error("K02_4k_dwab_103f.exr", {"--max-chunk-mib", "300"}), "--max-chunk-mib, for which 387 MiB"))
      << said_.err;
}

TEST_F(FieldPicture, AnUnknownCompressionIsNoDamage) {
  const std::string words = error("D01_htj2k.exr");
  EXPECT_TRUE(says(words, "HTJ2K256, which OpenEXR 3.4"));
  EXPECT_FALSE(says(words, "damaged"));
}

TEST_F(FieldPicture, WhatThereIsOfAnUnfinishedFileCanBeRendered) {
  for (const std::string name : {"D02_unfinished.exr", "D03_tiles_missing.exr"}) {
    const std::string words = error(name);
    EXPECT_TRUE(says(words, "unfinished"));
    EXPECT_TRUE(says(words, "--incomplete fill"));
    EXPECT_FALSE(says(words, "damaged"));
    expect_c(name, {"--incomplete", "fill"});
    const std::string missing = name[2] == '2' ? "128" : "256";
    EXPECT_TRUE(says(said_.out, missing + " pixels missing"));
    const nlohmann::json frame =
        candela_json({"render", file(name), folder_.path("out.exr"), "--incomplete", "fill"});
    EXPECT_EQ(absl::StrCat(frame.at("missing_pixels").get<int>()), missing);
    ASSERT_OK_AND_ASSIGN(const Image image, read_image(folder_.path("out.exr")));
    EXPECT_TRUE(image.has_alpha);
  }
}

TEST_F(FieldPicture, AnExrOutputKeepsWhatStaysTrueOfItsInput) {
  const std::string out = folder_.path("out.exr");
  const Outcome run = candela({"render", file("W03_display_offset.exr"), out});
  ASSERT_EQ(run.code, 0) << run.err;
  const Imf::InputFile input(file("W03_display_offset.exr").c_str()), output(out.c_str());
  EXPECT_EQ(output.header().displayWindow(), input.header().displayWindow());
  EXPECT_EQ(output.header().dataWindow(), input.header().displayWindow());
  EXPECT_EQ(output.header().pixelAspectRatio(), 2);
  EXPECT_EQ(Imf::owner(output.header()), "studio");
  EXPECT_EQ(Imf::comments(output.header()), "shot 7");
  EXPECT_EQ(Imf::timeCode(output.header()), Imf::timeCode(input.header()));
  EXPECT_EQ(Imf::framesPerSecond(output.header()).n, 24000);
  EXPECT_EQ(Imf::framesPerSecond(output.header()).d, 1001u);
}

TEST_F(FieldPicture, ACubeMapIsReadAsOne) {
  const std::string cube = file("E01_envcube.exr");
  picture("E01_envcube.exr");
  expect_note("the file is a cube map (envmap)");
  const nlohmann::json bake = candela_json({"environment", cube, folder_.path("pano.exr")});
  ASSERT_OK_AND_ASSIGN(const Image panorama, read_image(folder_.path("pano.exr")));
  const uint32_t w = panorama.width, h = panorama.height;
  ASSERT_EQ(w, 2 * h);
  // The faces are +X red, -X cyan, +Y green, -Y magenta, +Z blue, -Z yellow.
  const auto expect_light = [&](uint32_t x, uint32_t y, std::array<float, 3> rgb) {
    const std::array<float, 3> shown = pixel(panorama, x, y);
    for (size_t c = 0; c < 3; ++c) EXPECT_NEAR(shown[c], rgb[c], 0.02) << x << "," << y;
  };
  expect_light(w / 2, h / 2, {0, 0, 1});
  expect_light(w / 4, h / 2, {1, 0, 0});
  expect_light(3 * w / 4, h / 2, {0, 1, 1});
  expect_light(0, h / 2, {1, 1, 0});
  expect_light(w / 2, 0, {0, 1, 0});
  expect_light(w / 2, h - 1, {1, 0, 1});
  const Outcome view = candela({"view", cube, folder_.path("view.png"), "--size", "32x16"});
  EXPECT_EQ(view.code, 0) << view.err;
}

TEST_F(FieldPicture, RadianceHeadersAreReadAsRadianceDoes) {
  expect_c("H03_gamma22.hdr");
  expect_note("GAMMA 2.2 was ignored");
  expect_c("H12_exposure_unit.hdr", {}, 0.5f);
  expect_note("EXPOSURE 2 divided out");
}

TEST_F(FieldPicture, PfmHeadersMayHaveCrLfAndComments) {
  expect_c("P02_crlf.pfm");
  expect_c("P03_comment.pfm");
}

// Runs the command on every file of the shared test data: good files become pictures, and damaged ones are
// refused by name.

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
