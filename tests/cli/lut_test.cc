// `candela render --lut`: a LUT's file in place of a curve.
#include <ImathMatrix.h>
#include <ImathVec.h>
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstdio>
#include <optional>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "client/color/view_table.h"
#include "server/render/color/primaries.h"
#include "tests/cli/command.h"
#include "tests/cli/images.h"
#include "tests/support/files.h"
#include "tests/support/status.h"

namespace candela {
namespace {

// A cube that shows value^power.
std::string cube(double power, int size = 17) {
  std::string text = absl::StrCat("LUT_3D_SIZE ", size, "\n");
  const auto value = [&](int i) { return std::pow(static_cast<double>(i) / (size - 1), power); };
  for (int b = 0; b < size; ++b) {
    for (int g = 0; g < size; ++g) {
      for (int r = 0; r < size; ++r) absl::StrAppend(&text, value(r), " ", value(g), " ", value(b), "\n");
    }
  }
  return text;
}

class Lut : public ::testing::Test {
 protected:
  Lut() {
    write_small_exr(in_);
    write_file(identity_, cube(1.0));
  }

  const TemporaryFolder folder_;
  const std::string in_ = folder_.path("in.exr");
  const std::string out_ = folder_.path("out.png");
  const std::string identity_ = folder_.path("identity.cube");
};

// The values of 18 % grey that the manufacturers and the Academy publish.
TEST_F(Lut, TakesGreyAsItsInputSaysIt) {
  const std::pair<const char*, double> published[] = {
      {"linear", 0.18},          {"aces2065-1", 0.18}, {"acescg", 0.18},       {"acescc", 0.4135884},
      {"acescct", 0.4135884},    {"logc3", 0.391007},  {"logc4", 0.2783958},   {"slog3", 0.4105572},
      {"slog3-cine", 0.4105572}, {"vlog", 0.4233114},  {"log3g10", 0.3333333}, {"clog2", 0.3982554},
      {"clog3", 0.3433894},      {"log2", 0.0}};
  ASSERT_EQ(lut_inputs().size(), std::size(published));
  for (const auto& [word, expected] : published) {
    const ViewChoice choice{.config = identity_, .source = "--lut", .lut_input = word};
    ASSERT_OK_AND_ASSIGN(const ViewTable baked, bake_view(choice));
    std::vector<float> grey = {0.18f, 0.18f, 0.18f};
    baked.show(grey);
    // The cube cuts log2 0.18 = -2.47 to 0.
    for (const float v : grey) EXPECT_NEAR(v, expected, 2e-4) << word;
    EXPECT_LE(baked.mean_codes, 0.4) << word;
  }
}

// A camera's published primaries (CIE 1931 xy; the white is D65) and logarithm.
struct Camera {
  const char* word;
  Chromaticities primaries;
  double (*log)(double light);
};
double slog3(double x) { return (420 + std::log10((x + 0.01) / 0.19) * 261.5) / 1023; }
const Camera kCameras[] = {
    {"logc3",
     {{0.6840, 0.3130, 0.2210, 0.8480, 0.0861, -0.1020, 0.3127, 0.3290}},
     [](double x) { return 0.247190 * std::log10(5.555556 * x + 0.052272) + 0.385537; }},
    {"logc4",
     {{0.7347, 0.2653, 0.1424, 0.8576, 0.0991, -0.0308, 0.3127, 0.3290}},
     [](double x) { return (std::log2(2231.82630906769 * x + 64) - 6) / 14 * (928.0 / 1023) + 95.0 / 1023; }},
    {"slog3", {{0.730, 0.280, 0.140, 0.855, 0.100, -0.050, 0.3127, 0.3290}}, slog3},
    {"slog3-cine", {{0.766, 0.275, 0.225, 0.800, 0.089, -0.087, 0.3127, 0.3290}}, slog3},
    {"vlog",
     {{0.730, 0.280, 0.165, 0.840, 0.100, -0.030, 0.3127, 0.3290}},
     [](double x) { return 0.241514 * std::log10(x + 0.00873) + 0.598206; }},
    {"log3g10",
     {{0.780308, 0.304253, 0.121595, 1.493994, 0.095612, -0.084589, 0.3127, 0.3290}},
     [](double x) { return 0.224282 * std::log10((x + 0.01) * 155.975327 + 1); }},
    {"clog2",
     {{0.740, 0.270, 0.170, 1.140, 0.080, -0.100, 0.3127, 0.3290}},
     [](double x) { return 0.24136077 * std::log10(87.09937546 * x / 0.9 + 1) + 0.092864125; }},
    {"clog3", {{0.740, 0.270, 0.170, 1.140, 0.080, -0.100, 0.3127, 0.3290}}, [](double x) {
       return 0.36726845 * std::log10(14.98325 * x / 0.9 + 1) + 0.12240537;
     }}};

// Grey is the same in every gamut. This colour tells them apart: S-Gamut3 from S-Gamut3.Cine by 0.017.
TEST_F(Lut, TakesAColourInTheCamerasOwnGamut) {
  constexpr float kColor[] = {0.6f, 0.12f, 0.03f};
  for (const Camera& camera : kCameras) {
    const std::array<float, 9> m = **matrix_to_rec709(camera.primaries);
    const Imath::M33d to_rec709(m[0], m[3], m[6], m[1], m[4], m[7], m[2], m[5], m[8]);  // of row vectors
    const Imath::V3d own = Imath::V3d(kColor[0], kColor[1], kColor[2]) * to_rec709.inverse();
    const ViewChoice choice{.config = identity_, .source = "--lut", .lut_input = camera.word};
    ASSERT_OK_AND_ASSIGN(const ViewTable baked, bake_view(choice));
    std::vector<float> shown(std::begin(kColor), std::end(kColor));
    baked.show(shown);
    for (int k = 0; k < 3; ++k) {
      EXPECT_NEAR(shown[k], camera.log(own[k]), 1e-3) << camera.word << " " << k;
    }
  }
}

// S-2014-003 and S-2016-001: they are the same but in the dark.
TEST_F(Lut, TellsAcesccFromAcescct) {
  for (const auto& [word, expected] : {std::pair("acescc", 0.043050), {"acescct", 0.093986}}) {
    const ViewChoice choice{.config = identity_, .source = "--lut", .lut_input = word};
    ASSERT_OK_AND_ASSIGN(const ViewTable baked, bake_view(choice));
    std::vector<float> grey = {0.002f, 0.002f, 0.002f};
    baked.show(grey);
    EXPECT_NEAR(grey[1], expected, 1e-4) << word;
  }
}

// Files that say it and options say the same.
TEST_F(Lut, TakesItsDomainFromTheFileOrTheOption) {
  int files = 0;
  const auto shown = [&](const std::string& text, const std::string& input,
                         std::optional<std::pair<double, double>> domain) {
    const std::string file = folder_.path(absl::StrCat(++files, ".cube"));  // OpenColorIO keeps files by name
    write_file(file, text);
    const ViewChoice choice{.config = file, .source = "--lut", .lut_input = input, .lut_domain = domain};
    const absl::StatusOr<ViewTable> baked = bake_view(choice);
    EXPECT_OK(baked);
    std::vector<float> light = {1.0f, 2.0f, 5.0f};
    if (baked.ok()) baked->show(light);
    return light;
  };
  const auto near = [](const std::vector<float>& v, const std::vector<float>& expected) {
    for (size_t k = 0; k < 3; ++k) EXPECT_NEAR(v[k], expected[k], 1e-5);
  };
  const std::vector<float> quarters = {0.25f, 0.5f, 1.0f};
  near(shown(cube(1.0), "linear", std::nullopt), {1.0f, 1.0f, 1.0f});
  near(shown(cube(1.0), "linear", std::pair(0.0, 4.0)), quarters);
  near(shown("DOMAIN_MIN 0 0 0\nDOMAIN_MAX 4 4 4\n" + cube(1.0), "linear", std::nullopt), quarters);
  const std::string cube_17 = cube(1.0);
  const size_t line = cube_17.find('\n') + 1;
  near(shown(cube_17.substr(0, line) + "LUT_3D_INPUT_RANGE 0 4\n" + cube_17.substr(line), "linear",
             std::nullopt),
       quarters);
  // A shaper of two points in the same file: it halves.
  near(shown("LUT_1D_SIZE 2\nLUT_1D_INPUT_RANGE 0 8\n" + cube_17.substr(0, line) +
                 "LUT_3D_INPUT_RANGE 0 4\n0 0 0\n4 4 4\n" + cube_17.substr(line),
             "linear", std::nullopt),
       {0.125f, 0.25f, 0.625f});
  near(shown(cube(1.0), "log2", std::pair(-2.0, 6.0)), {0.25f, 0.375f, (2.0f + std::log2(5.0f)) / 8.0f});
}

TEST_F(Lut, AnImageIsWhatOpenColorIOShows) {
  write_file(folder_.path("root.cube"), cube(0.5, 65));
  for (const char* input : {"acescct", "logc4"}) {
    const auto report = candela_json(
        {"render", in_, out_, "--lut", folder_.path("root.cube"), "--lut-input", input, "--verify"});
    EXPECT_EQ(report["view"]["view"], "root.cube");
    EXPECT_EQ(report["view"]["input"], input);
    EXPECT_LE(report["verify_view"]["mean_error_codes"], 0.4);
    EXPECT_LE(report["verify"]["max_error_codes"], 0.05);
    EXPECT_EQ(report["exposure"], 1.0);
  }
}

TEST_F(Lut, ADomainBelow0GetsANote) {
  const auto notes = [&](const char* domain) {
    return candela({"render", in_, out_, "--lut", identity_, "--lut-domain", domain}).err;
  };
  EXPECT_TRUE(says(notes("-0.125,1"), "the LUT's domain begins below 0"));
  EXPECT_EQ(notes("0,1").find("below 0"), std::string::npos);
}

TEST_F(Lut, WhatDoesNotGoTogetherIsRefused) {
  const auto refused = [&](std::vector<std::string> more, int code, const std::string& words) {
    std::vector<std::string> all = {"render", in_, out_};
    all.insert(all.end(), more.begin(), more.end());
    const Outcome outcome = candela(all);
    EXPECT_EQ(outcome.code, code) << outcome.err;
    EXPECT_TRUE(says(outcome.err, words)) << outcome.err;
  };
  refused({"--lut", identity_, "--curve", "agx"}, 2, "--lut replaces --curve");
  refused({"--lut", identity_, "--ocio", "x.ocio"}, 2, "--lut is a view by itself");
  refused({"--lut", identity_, "--ocio-view", "Dark"}, 2, "--lut is a view by itself");
  refused({"--lut-input", "acescct"}, 2, "name one with --lut");
  refused({"--lut", identity_, "--lut-input", "acesct"}, 2, "acescct");
  refused({"--lut-domain", "0,4"}, 2, "--lut-domain says what a LUT takes; name one with --lut");
  for (const char* domain : {"4", "4,4", "4,1", "a,1", "0,nan", "0,1e9"}) {
    refused({"--lut", identity_, "--lut-domain", domain}, 2, "--lut-domain");
  }
  refused({"--lut", folder_.path("none.cube")}, 3, "no such file; --lut takes a LUT");
  refused({"--lut", in_}, 3, "it is an image; --lut takes a LUT");
  std::string commas = "TITLE \"1,5\"\n" + cube(1.0);
  commas.replace(commas.find("0.0625"), 6, "0,0625");
  write_file(folder_.path("comma.cube"), commas);
  refused({"--lut", folder_.path("comma.cube")}, 3,
          "comma.cube: line 4, \"0,0625 0 0\": numbers in a LUT have decimal points");
  write_file(folder_.path("bad.cube"), "LUT_3D_SIZE 2\n0 0 0\n");
  refused({"--lut", folder_.path("bad.cube")}, 3, "OpenColorIO cannot use it");
}

}  // namespace
}  // namespace candela
