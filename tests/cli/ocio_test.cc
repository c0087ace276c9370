// `candela render --ocio`: any view of an OpenColorIO configuration.
#include <OpenColorIO/OpenColorIO.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>

#include "client/image/image.h"
#include "tests/cli/command.h"
#include "tests/cli/images.h"
#include "tests/support/files.h"
#include "tests/support/status.h"

namespace candela {
namespace {

// A small version of a studio's configuration. `roles` decide what it says about its primaries; `displays`
// are those with their views, and `spaces` are colour spaces besides ACES2065-1 and ACEScg.
std::string config(const std::string& roles, const std::string& displays, const std::string& spaces = "") {
  return "ocio_profile_version: 2\n\nroles:\n" + roles + R"(  default: ACEScg
file_rules:
  - !<Rule> {name: Default, colorspace: default}
displays:
)" + displays +
         R"(view_transforms:
  - !<ViewTransform>
    name: Plain
    from_scene_reference: !<BuiltinTransform> {style: UTILITY - ACES-AP0_to_CIE-XYZ-D65_BFD}
  - !<ViewTransform>
    name: ACES
    from_scene_reference: !<BuiltinTransform> {style: ACES-OUTPUT - ACES2065-1_to_CIE-XYZ-D65 - SDR-VIDEO_1.0}
display_colorspaces:
  - !<ColorSpace>
    name: CIE-XYZ-D65
  - !<ColorSpace>
    name: sRGB - Display
    from_display_reference: !<BuiltinTransform> {style: DISPLAY - CIE-XYZ-D65_to_sRGB}
  - !<ColorSpace>
    name: P3 - Display
    from_display_reference: !<BuiltinTransform> {style: DISPLAY - CIE-XYZ-D65_to_G2.6-P3-D65}
colorspaces:
  - !<ColorSpace>
    name: ACES2065-1
  - !<ColorSpace>
    name: ACEScg
    to_scene_reference: !<BuiltinTransform> {style: ACEScg_to_ACES2065-1}
)" + spaces;
}

constexpr char kStudioDisplays[] = R"(  sRGB:
    - !<View> {name: ACES, view_transform: ACES, display_colorspace: sRGB - Display}
    - !<View> {name: Plain, view_transform: Plain, display_colorspace: sRGB - Display}
  Cinema:
    - !<View> {name: ACES, view_transform: ACES, display_colorspace: P3 - Display}
)";

constexpr char kStudioRoles[] =
    "  aces_interchange: ACES2065-1\n  cie_xyz_d65_interchange: CIE-XYZ-D65\n  scene_linear: ACEScg\n";

class Ocio : public ::testing::Test {
 protected:
  Ocio() {
    write_small_exr(in_);
    write_file(studio_, config(kStudioRoles, kStudioDisplays));
  }

  static void expect_error(const Outcome& outcome, int code, const std::string& words) {
    EXPECT_EQ(outcome.code, code) << outcome.err;
    EXPECT_EQ(std::count(outcome.err.begin(), outcome.err.end(), '\n'), 1) << outcome.err;
    EXPECT_TRUE(says(outcome.err, words));
  }

  const TemporaryFolder folder_;
  const std::string in_ = folder_.path("in.exr");
  const std::string studio_ = folder_.path("studio.ocio");
};

TEST_F(Ocio, AnAcesViewIsTheCurveAces1) {
  const auto report = candela_json({"render", in_, folder_.path("view.pfm"), "--ocio", studio_});
  EXPECT_EQ(report["view"]["display"], "sRGB");
  EXPECT_EQ(report["view"]["view"], "ACES");
  EXPECT_EQ(report["view"]["input"], "ACES2065-1");
  EXPECT_EQ(report["view"]["table_size"], 65);
  EXPECT_LE(report["view"]["max_codes"], 5.0);
  EXPECT_LE(report["view"]["p999_codes"], 0.9);
  EXPECT_LE(report["view"]["mean_codes"], 0.06);
  EXPECT_TRUE(says(report["notes"].dump(), "view's display values"));
  EXPECT_TRUE(report["stage_ms"].contains("view"));
  const auto curve = candela_json({"render", in_, folder_.path("curve.pfm"), "--curve", "aces-1",
                                   "--exposure", "0", "--bloom-intensity", "0"});
  EXPECT_TRUE(curve["view"].is_null());
  const std::vector<float> view = pfm_values(folder_.path("view.pfm"));
  const std::vector<float> light = pfm_values(folder_.path("curve.pfm"));
  ASSERT_EQ(view.size(), light.size());
  for (size_t i = 0; i < view.size(); ++i) {
    const double y = light[i];
    const double value = y <= 0.0031308 ? 12.92 * y : 1.055 * std::pow(y, 1 / 2.4) - 0.055;
    EXPECT_NEAR(view[i], value, 2.0 / 255.0) << i;
  }
}

TEST_F(Ocio, WideGamutLightIsVerifiedAgainstTheViewItself) {
  // Colours as in an ACEScg file: a pure primary is far outside of Rec.709.
  const auto report = candela_json({"render", in_, folder_.path("out.png"), "--ocio", studio_, "--verify",
                                    "--primaries", "aces-ap1", "--exposure", "2"});
  EXPECT_EQ(report["verify_view"]["against"], "OpenColorIO's view of the uncut light");
  EXPECT_EQ(report["verify_view"]["opaque_pixels"], 31 * 17);
  EXPECT_GT(report["verify_view"]["max_error_codes"], 0.1);  // 8 bits
  EXPECT_LE(report["verify_view"]["max_error_codes"], 3.5);
  EXPECT_LE(report["verify_view"]["mean_error_codes"], 0.4);
  EXPECT_EQ(report["verify"]["against"], "the view's table, looked up in float64");
  EXPECT_LE(report["verify"]["max_error_codes"], 0.01);
  const auto plain = candela_json({"render", in_, folder_.path("out.png"), "--verify"});
  EXPECT_FALSE(plain.contains("verify_view"));
  EXPECT_EQ(plain["verify"]["against"], "the float64 reference");
}

// Its light is resized, and not the values of the file or of the view.
TEST_F(Ocio, AResizedImageIsVerifiedAgainstTheViewOfResizedLight) {
  for (const char* size : {"15x9", "200%"}) {
    const auto report = candela_json({"render", in_, folder_.path("out.png"), "--ocio", studio_, "--verify",
                                      "--resize", size, "--exposure", "-2"});
    const double pixels = report["size"]["width"].get<double>() * report["size"]["height"].get<double>();
    EXPECT_EQ(report["verify_view"]["opaque_pixels"], pixels) << size;
    EXPECT_GT(report["verify_view"]["max_error_codes"], 0.1) << size;  // 8 bits
    EXPECT_LE(report["verify_view"]["max_error_codes"], 1.5) << size;
    EXPECT_LE(report["verify"]["max_error_codes"], 0.05) << size;
  }
}

// Only colours with a negative component are not rounded to half. The rounding of the others is no error.
TEST_F(Ocio, OneNegativePixelAddsNoErrorToTheOthers) {
  const auto error_with = [&](float first) {
    std::string pfm = "PF\n64 48\n-1.0\n";
    for (int i = 0; i < 64 * 48 * 3; ++i) {
      const float value = i == 0 ? first : 0.2f + 0.0001f * static_cast<float>(i);
      pfm.append(reinterpret_cast<const char*>(&value), sizeof value);
    }
    const std::string in = folder_.path("float.pfm");
    write_file(in, pfm);
    const auto report =
        candela_json({"render", in, folder_.path("float-out.pfm"), "--ocio", studio_, "--ocio-view", "Plain",
                      "--verify", "--bloom-intensity", "0", "--exposure", "0"});
    return report["verify_view"]["mean_error_codes"].get<double>();
  };
  EXPECT_NEAR(error_with(-0.001f), error_with(0.2f), 1e-4);
}

TEST_F(Ocio, EveryViewHasItsMeasuredError) {
  const auto plain =
      candela_json({"render", in_, folder_.path("plain.png"), "--ocio", studio_, "--ocio-view", "Plain"});
  EXPECT_EQ(plain["view"]["view"], "Plain");
  EXPECT_LE(plain["view"]["max_codes"], 3.0);
  const auto cinema =
      candela_json({"render", in_, folder_.path("cinema.png"), "--ocio", studio_, "--display", "Cinema"});
  EXPECT_EQ(cinema["view"]["display"], "Cinema");
  EXPECT_LE(cinema["view"]["mean_codes"], 0.3);
}

TEST_F(Ocio, SaysWhatItAssumesAboutPrimaries) {
  const std::string loose = folder_.path("loose.ocio");
  write_file(loose, config("  scene_linear: ACEScg\n", kStudioDisplays));
  const auto report = candela_json({"render", in_, folder_.path("out.png"), "--ocio", loose});
  EXPECT_EQ(report["view"]["input"], "ACEScg");
  EXPECT_TRUE(says(report["notes"].dump(), "taken to be linear Rec.709; --ocio-input names another"));
  const auto named =
      candela_json({"render", in_, folder_.path("out.png"), "--ocio", loose, "--ocio-input", "ACES2065-1"});
  EXPECT_EQ(named["view"]["input"], "ACES2065-1");
  EXPECT_FALSE(says(named["notes"].dump(), "taken to be"));

  write_file(loose, config("", kStudioDisplays));
  expect_error(
      candela({"render", in_, folder_.path("out.png"), "--ocio", loose, "-q"}), 3,
      "has neither a role aces_interchange nor scene_linear; name its linear Rec.709 with --ocio-input: ");
}

TEST_F(Ocio, ARoleThatNamesAMissingColourSpaceIsNamed) {
  const std::string broken = folder_.path("broken.ocio");
  for (const std::string role : {"aces_interchange", "scene_linear"}) {
    write_file(broken, config("  " + role + ": Missing\n", kStudioDisplays));
    expect_error(candela({"render", in_, folder_.path("out.png"), "--ocio", broken, "-q"}), 3,
                 broken + ": its role " + role + " names a colour space that it does not have");
  }
}

TEST_F(Ocio, WhatIsNotThereIsNamedBesideWhatIs) {
  const auto render = [this](std::vector<std::string> options) {
    options.insert(options.begin(), {"render", in_, folder_.path("out.png"), "-q"});
    return candela(options);
  };
  expect_error(render({"--ocio", studio_, "--display", "TV"}), 3,
               "has no display \"TV\"; there are: sRGB, Cinema");
  expect_error(render({"--ocio", studio_, "--ocio-view", "Film"}), 3,
               "has no view \"Film\" for display \"sRGB\"; there are: ACES, Plain");
  expect_error(render({"--ocio", studio_, "--ocio-input", "XYZ"}), 3,
               "has no colour space \"XYZ\"; there are: ");
  expect_error(render({"--ocio", folder_.path("none.ocio")}), 3,
               "no such file; --ocio takes an OpenColorIO configuration");
  expect_error(render({"--ocio", in_}), 3, "OpenColorIO cannot use it: ");
  write_file(folder_.path("empty.ocio"), "");
  expect_error(render({"--ocio", folder_.path("empty.ocio")}), 3, "OpenColorIO cannot use it: ");
  expect_error(render({"--display", "sRGB"}), 2,
               "--display is part of an OpenColorIO configuration; name one with --ocio CONFIG");
  expect_error(render({"--exr-view", "ACES"}), 3, "there is no view \"ACES\"; the file names no views");
  expect_error(render({"--ocio-input", "ACEScg"}), 2, "--ocio-input is part of");
  expect_error(render({"--ocio", studio_, "--curve", "agx"}), 2, "--ocio replaces --curve");
  expect_error(render({"--ocio", studio_, "--ocio-view", ""}), 2, "--ocio-view is empty");
  expect_error(render({"--curve", "table"}), 2, "unknown curve \"table\"");
}

// Studios' configurations of 2025 and later.
TEST_F(Ocio, AConfigurationThatIsTooNewNamesTheWaysAround) {
  const std::string later = folder_.path("later.ocio");
  std::string text = config(kStudioRoles, kStudioDisplays);
  write_file(later, "ocio_profile_version: 2.4" + text.substr(text.find('\n')));
  const std::string aces2 = folder_.path("aces2.ocio");
  const std::string style = "ACES-OUTPUT - ACES2065-1_to_CIE-XYZ-D65 - SDR-100nit-REC709_2.0";
  const std::string old = "ACES-OUTPUT - ACES2065-1_to_CIE-XYZ-D65 - SDR-VIDEO_1.0";
  text.replace(text.find(old), old.size(), style);
  write_file(aces2, text);
  for (const auto& [name, reason] :
       {std::pair(later, std::string("it is of version 2.4")),
        std::pair(aces2, "it has the built-in transform \"" + style + "\""),
        std::pair(std::string("ocio://default"), std::string("it has no built-in configurations"))}) {
    const std::string why =
        name + ": OpenColorIO " + OCIO_VERSION + ", which is installed here, is too old for it: " + reason;
    const std::string ways =
        "; --curve aces-2 shows ACES 2.0, and a newer OpenColorIO can bake any view, as a LUT (ociobakelut) "
        "for --lut or by bake_view() of Candela's Python package";
    expect_error(candela({"render", in_, folder_.path("out.png"), "--ocio", name, "-q"}), 3, why + ways);
    expect_error(candela({"info", "--ocio", name}), 3, why + ways);
  }
}

TEST_F(Ocio, InfoListsDisplaysAndViews) {
  const Outcome text = candela({"info", "--ocio", studio_});
  ASSERT_EQ(text.code, 0) << text.err;
  EXPECT_TRUE(says(text.out,
                   "OpenColorIO configuration, version 2.0, 5 colour spaces\n"
                   "  display \"sRGB\" (default)\n"
                   "    view \"ACES\" (default)\n"
                   "    view \"Plain\"\n"
                   "  display \"Cinema\"\n"
                   "    view \"ACES\" (default)\n"))
      << text.out;
  const auto info = candela_json({"info", "--ocio", studio_});
  EXPECT_EQ(info["config"], studio_);
  EXPECT_EQ(info["default_display"], "sRGB");
  EXPECT_EQ(info["displays"][0]["views"], nlohmann::json({"ACES", "Plain"}));
  EXPECT_EQ(info["displays"][1]["name"], "Cinema");
  EXPECT_EQ(info["displays"][1]["default_view"], "ACES");
  EXPECT_TRUE(std::ranges::count(info["color_spaces"], "ACEScg") == 1) << info;
  // Each of them can be shown.
  for (const auto& display : info["displays"]) {
    for (const std::string view : display["views"]) {
      const std::string name = display["name"];
      EXPECT_EQ(candela({"render", in_, folder_.path("out.png"), "--ocio", studio_, "--display", name,
                         "--ocio-view", view, "-q"})
                    .code,
                0);
    }
  }
  expect_error(candela({"info", in_, "--ocio", studio_}), 2, "give only one of them");
  expect_error(candela({"info", "--ocio", folder_.path("none.ocio")}), 3, "none.ocio: no such file");
}

TEST_F(Ocio, TransferChangesNothing) {
  const auto srgb = candela_json({"render", in_, folder_.path("a.png"), "--ocio", studio_});
  const auto linear =
      candela_json({"render", in_, folder_.path("b.png"), "--ocio", studio_, "--transfer", "linear"});
  EXPECT_TRUE(says(linear["notes"].dump(), "--transfer changes nothing"));
  EXPECT_EQ(read_file(folder_.path("a.png")), read_file(folder_.path("b.png")));
}

// A managed view shows what is there.
TEST_F(Ocio, TheDefaultIsZeroEvWithoutBloomAndTheLineSaysSo) {
  const std::string out = folder_.path("out.png");
  const Outcome plain = candela({"render", in_, out, "--ocio", studio_});
  ASSERT_EQ(plain.code, 0) << plain.err;
  EXPECT_TRUE(says(plain.out, "exposure 1 (+0.00 EV, the default of a view), no bloom; ACES;"));
  const std::string shown = read_file(out);
  ASSERT_EQ(
      candela({"render", in_, out, "--ocio", studio_, "--exposure", "0", "--bloom-intensity", "0"}).code, 0);
  EXPECT_EQ(read_file(out), shown);

  const auto metered = candela_json({"render", in_, out, "--ocio", studio_, "--exposure", "auto"});
  EXPECT_NE(metered.at("exposure"), 1.0);
  EXPECT_EQ(metered.at("exposure"), candela_json({"render", in_, out}).at("exposure"));
  ASSERT_EQ(candela({"render", in_, out, "--ocio", studio_, "--bloom", "conserve", "-q"}).code, 0);
  EXPECT_NE(read_file(out), shown);
  const auto idle = candela_json({"render", in_, out, "--ocio", studio_, "--compensation", "1"});
  EXPECT_TRUE(says(idle.at("notes").dump(),
                   "--compensation changes nothing: with --ocio and --lut the exposure is 0 EV"))
      << idle.at("notes");
  // Whoever asks to adapt gets it.
  EXPECT_NE(candela_json({"render", in_, out, "--ocio", studio_, "--previous-exposure", "4"}).at("exposure"),
            1.0);

  const Outcome stream = candela({"stream", in_, folder_.path("s_%d.png"), "--ocio", studio_});
  ASSERT_EQ(stream.code, 0) << stream.err;
  EXPECT_TRUE(says(stream.out, "+0.00 EV, the default of a view), no bloom"));
}

TEST_F(Ocio, TheVariableOcioIsTheDefaultAndTheLineSaysSo) {
  const std::string out = folder_.path("out.png");
  const auto with = [&](const std::string& value, std::vector<std::string> options) {
    options.insert(options.begin(), {"render", in_, out});
    return candela_in_shell("export OCIO=" + value, options);
  };
  const Outcome chosen = with(studio_, {});
  ASSERT_EQ(chosen.code, 0) << chosen.err;
  EXPECT_TRUE(says(chosen.out, "; ACES of $OCIO;"));
  const std::string shown = read_file(out);
  ASSERT_EQ(candela({"render", in_, out, "--ocio", studio_}).code, 0);
  EXPECT_EQ(read_file(out), shown);
  EXPECT_EQ(with(studio_, {"--ocio-view", "Plain"}).code, 0);
  EXPECT_NE(read_file(out), shown);

  // A curve, another configuration and an empty variable do without it.
  for (const std::vector<std::string>& options :
       {std::vector<std::string>{"--curve", "agx"}, {"--ocio", studio_, "-q"}}) {
    const Outcome other = with(folder_.path("missing.ocio"), options);
    EXPECT_EQ(other.code, 0) << other.err;
    EXPECT_FALSE(says(other.out, "$OCIO"));
  }
  const Outcome empty = with("", {});
  EXPECT_EQ(empty.code, 0) << empty.err;
  EXPECT_FALSE(says(empty.out, "OCIO"));
  const std::string missing = folder_.path("missing.ocio");
  expect_error(with(missing, {"-q"}), 3,
               missing +
                   ": no such file; --ocio takes an OpenColorIO configuration; $OCIO names the "
                   "configuration, and --curve does without it");
}

// `candela render --ocio-input`: pictures are compared with what OpenColorIO itself makes of the file's
// values.

namespace ocio = OCIO_NAMESPACE;

constexpr char kInputDisplays[] = R"(  sRGB:
    - !<View> {name: ACES, view_transform: ACES, display_colorspace: sRGB - Display}
    - !<View> {name: Plain, view_transform: Plain, display_colorspace: sRGB - Display}
    - !<View> {name: Raw, colorspace: Raw}
    - !<View> {name: Log, colorspace: ACEScct}
)";
constexpr char kInputSpaces[] = R"(  - !<ColorSpace>
    name: ACEScct
    to_scene_reference: !<BuiltinTransform> {style: ACEScct_to_ACES2065-1}
  - !<ColorSpace>
    name: Picture
    to_scene_reference: !<GroupTransform>
      children:
        - !<ExponentWithLinearTransform> {gamma: 2.4, offset: 0.055}
        - !<BuiltinTransform> {style: UTILITY - ACES-AP1_to_LINEAR-REC709_BFD, direction: inverse}
        - !<BuiltinTransform> {style: ACEScg_to_ACES2065-1}
  - !<ColorSpace>
    name: Raw
    isdata: true
)";

constexpr char kInterchange[] = "  aces_interchange: ACES2065-1\n  cie_xyz_d65_interchange: CIE-XYZ-D65\n";

struct Error {
  double most = 0, mean = 0;  // codes
};

class OcioInput : public ::testing::Test {
 protected:
  OcioInput() { write_file(studio_, config(kInterchange, kInputDisplays, kInputSpaces)); }

  // Renders the file, and compares the picture with OpenColorIO's own.
  Error error_of(const std::string& in, const std::string& config, const std::string& input,
                 const std::string& view) {
    const std::string out = folder_.path("out.pfm");
    report_ = candela_json(
        {"render", in, out, "--ocio", config, "--ocio-input", input, "--ocio-view", view, "--verify"});
    const std::vector<float> shown = pfm_values(out);
    absl::StatusOr<Image> own = read_image(in, {}, {.own_values = true, .as_floats = true});
    if (!own.ok()) {
      ADD_FAILURE() << own.status();
      return {999, 999};
    }
    const auto transform = ocio::DisplayViewTransform::Create();
    transform->setSrc(input.c_str());
    transform->setDisplay("sRGB");
    transform->setView(view.c_str());
    ocio::PackedImageDesc image(own->pixels.data(), own->width, own->height, 4);
    ocio::Config::CreateFromFile(config.c_str())
        ->getProcessor(transform)
        ->getOptimizedCPUProcessor(ocio::OPTIMIZATION_LOSSLESS)
        ->apply(image);
    Error error;
    size_t at = 0;
    for (uint32_t y = own->height; y-- > 0;) {
      for (uint32_t x = 0; x < own->width; ++x) {
        for (size_t c = 0; c < 3; ++c) {
          float right;
          std::memcpy(&right, own->pixels.data() + y * own->row_bytes() + (4 * x + c) * sizeof right,
                      sizeof right);
          right = right > 0 ? std::min(right, 1.0f) : 0.0f;
          const double off = 255 * std::abs(right - shown.at(at++));
          error.most = std::max(error.most, off);
          error.mean += off;
        }
      }
    }
    error.mean /= static_cast<double>(at);
    return error;
  }

  void expect_right(const std::string& in, const std::string& config, const std::string& input,
                    const std::string& view, double most = 3.0, double mean = 0.2) {
    SCOPED_TRACE(in + " as " + input + " through " + view);
    const Error error = error_of(in, config, input, view);
    EXPECT_LE(error.most, most);
    EXPECT_LE(error.mean, mean);
    // --verify has found the same, from the file's own values.
    EXPECT_NEAR(report_.at("verify_view").at("max_error_codes").get<double>(), error.most, 0.02);
    EXPECT_NEAR(report_.at("verify_view").at("mean_error_codes").get<double>(), error.mean, 0.01);
  }

  // Saturated colours of every hue from 2^-8 to 2^5, and greys.
  std::string write_hues(double scale = 1) {
    std::string pfm = "PF\n72 40\n-1.0\n";
    for (int y = 0; y < 40; ++y) {
      for (int x = 0; x < 72; ++x) {
        for (int c = 0; c < 3; ++c) {
          const double saturation = (y % 4) / 3.0;
          const double hue = 0.5 + 0.5 * std::cos((x / 72.0 + c / 3.0) * 2 * M_PI);
          const auto v =
              static_cast<float>(scale * std::exp2(y / 3.0 - 8) * (1 - saturation + saturation * hue));
          pfm.append(reinterpret_cast<const char*>(&v), sizeof v);
        }
      }
    }
    const std::string path = folder_.path("hues.pfm");
    write_file(path, pfm);
    return path;
  }

  const TemporaryFolder folder_;
  const std::string studio_ = folder_.path("studio.ocio");
  nlohmann::json report_;
};

// The tables' error at pure colours of AP1, which no picture has many of.
constexpr double kPure = 4.0;

TEST_F(OcioInput, LinearInputIsWhatOpenColorIoMakesOfIt) {
  const std::string in = write_hues();
  expect_right(in, studio_, "ACEScg", "ACES", kPure);
  EXPECT_EQ(report_.at("primaries").at("name"), "ACEScg");
  EXPECT_EQ(report_.at("primaries").at("from"), "ocio-input");
  expect_right(in, studio_, "ACEScg", "Plain");
}

TEST_F(OcioInput, EncodedInputIsWhatOpenColorIoMakesOfIt) {
  const std::string in = write_hues(1 / 32.0);
  expect_right(in, studio_, "ACEScct", "ACES", kPure);
  expect_right(in, studio_, "Picture", "ACES", kPure);
  expect_right(in, studio_, "Picture", "Plain", kPure, 0.4);
}

// OpenColorIO takes floats.
TEST_F(OcioInput, HalvesOfAPhmFileAreConverted) {
  const std::string in = folder_.path("in.phm");
  std::string halves = "PH\n64 64\n-1.0\n";
  for (int i = 0; i < 3 * 64 * 64; ++i) halves += {'\0', static_cast<char>(0x30 + i % 8)};  // 2^-3 .. 2
  write_file(in, halves);
  expect_right(in, studio_, "ACEScct", "ACES");
}

TEST_F(OcioInput, AConfigurationWithoutInterchangeIsAsAccurate) {
  const std::string loose = folder_.path("loose.ocio");
  write_file(loose, config("  scene_linear: ACEScg\n", kInputDisplays, kInputSpaces));
  expect_right(write_hues(), loose, "ACEScg", "ACES", kPure);
  write_file(loose, config("", kInputDisplays, kInputSpaces));
  expect_right(write_hues(), loose, "ACEScg", "ACES", kPure);
}

TEST_F(OcioInput, AViewOfDataShowsTheFilesValues) {
  const std::string in = write_hues(1 / 32.0);
  const Error error = error_of(in, studio_, "ACEScg", "Raw");
  EXPECT_LE(error.most, 0.1);
  EXPECT_EQ(report_.at("primaries").at("from"), "values");
  EXPECT_LE(report_.at("verify_view").at("max_error_codes").get<double>(), 0.1);
  const std::string raw = folder_.path("raw.pfm");
  // Whatever the primaries are, with or without an input.
  const auto plain =
      candela_json({"render", in, raw, "--ocio", studio_, "--ocio-view", "Raw", "--primaries", "acescg"});
  EXPECT_EQ(pfm_values(raw), pfm_values(folder_.path("out.pfm")));
  EXPECT_TRUE(says(plain.at("notes").dump(), "--primaries changes nothing"));
}

TEST_F(OcioInput, ExposureIsAppliedToSceneLight) {
  // A stop more light, encoded or not, is the same picture.
  const std::string in = write_hues();
  const auto values = [&](const std::string& file, const std::string& ev) {
    candela_json({"render", file, folder_.path("ev.pfm"), "--ocio", studio_, "--ocio-input", "ACEScg",
                  "--exposure", ev, "--verify"});
    return pfm_values(folder_.path("ev.pfm"));
  };
  const std::vector<float> brighter = values(in, "1");
  const std::vector<float> doubled = values(write_hues(2), "0");
  ASSERT_EQ(brighter.size(), doubled.size());
  for (size_t i = 0; i < brighter.size(); ++i) ASSERT_NEAR(brighter[i], doubled[i], 2e-3) << i;
}

TEST_F(OcioInput, RealPicturesAreWhatOpenColorIoMakesOfThem) {
  if (data_folder().empty()) GTEST_SKIP() << "no test data: set CANDELA_DATA to its folder";
  for (const char* name : {"/hdri/studio_small_03_1k.hdr", "/hdri/lebombo_1k.hdr", "/exr/StillLife.exr",
                           "/aces/target_ricd_190spectra.exr"}) {
    expect_right(data_folder() + name, studio_, "ACEScg", "ACES");
  }
}

TEST_F(OcioInput, StreamAndViewTakeItToo) {
  const std::string in = write_hues();
  candela_json({"render", in, folder_.path("one.png"), "--ocio", studio_, "--ocio-input", "ACEScct"});
  ASSERT_EQ(candela({"stream", in, folder_.path("s_%d.png"), "--ocio", studio_, "--ocio-input", "ACEScct",
                     "-q", "--first", "1"})
                .code,
            0);
  EXPECT_EQ(read_file(folder_.path("one.png")).substr(0, 100),
            read_file(folder_.path("s_1.png")).substr(0, 100));
  const std::string pano = folder_.path("pano.exr");
  ASSERT_EQ(candela({"sample", "--panorama", pano, "--size", "128x64"}).code, 0);
  const auto view = candela_json({"view", pano, folder_.path("view.png"), "--size", "64x36", "--ocio",
                                  studio_, "--ocio-input", "ACEScg"});
  EXPECT_EQ(view.at("primaries").at("name"), "ACEScg");
  EXPECT_EQ(view.at("exposure"), 1.0);
}

}  // namespace
}  // namespace candela
