// `candela render --ocio-input`: pictures are compared with what OpenColorIO itself makes of the file's
// values.
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

namespace ocio = OCIO_NAMESPACE;

// A studio's configuration. `roles` is what it says about its primaries.
std::string config_with(const std::string& roles) {
  return "ocio_profile_version: 2\n\nroles:\n" + roles +
         R"(  default: ACEScg
file_rules:
  - !<Rule> {name: Default, colorspace: default}
displays:
  sRGB:
    - !<View> {name: ACES, view_transform: ACES, display_colorspace: sRGB - Display}
    - !<View> {name: Plain, view_transform: Plain, display_colorspace: sRGB - Display}
    - !<View> {name: Raw, colorspace: Raw}
    - !<View> {name: Log, colorspace: ACEScct}
view_transforms:
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
colorspaces:
  - !<ColorSpace>
    name: ACES2065-1
  - !<ColorSpace>
    name: ACEScg
    to_scene_reference: !<BuiltinTransform> {style: ACEScg_to_ACES2065-1}
  - !<ColorSpace>
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
}

constexpr char kInterchange[] = "  aces_interchange: ACES2065-1\n  cie_xyz_d65_interchange: CIE-XYZ-D65\n";

struct Error {
  double most = 0, mean = 0;  // codes
};

class OcioInput : public ::testing::Test {
 protected:
  OcioInput() { write_file(studio_, config_with(kInterchange)); }

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
  write_file(loose, config_with("  scene_linear: ACEScg\n"));
  expect_right(write_hues(), loose, "ACEScg", "ACES", kPure);
  write_file(loose, config_with(""));
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
