// What OpenEXR files say about their colours: the ACES container flag, colorInteropID, chromaticities and
// adoptedNeutral.
#include <OpenEXR/ImfChromaticitiesAttribute.h>
#include <OpenEXR/ImfIntAttribute.h>
#include <OpenEXR/ImfMultiPartOutputFile.h>
#include <OpenEXR/ImfOutputPart.h>
#include <OpenEXR/ImfPartType.h>
#include <OpenEXR/ImfStandardAttributes.h>
#include <OpenEXR/ImfStringAttribute.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <map>

#include "client/image/color.h"
#include "client/image/describe.h"
#include "tests/support/status.h"
#include "tests/unit/image/exr_reader_fixture.h"

namespace candela {
namespace {

// (0.5, 0.2, 0.1), with alpha if it is not 1.
std::vector<ExrChannel> light(double alpha = 1, const std::string& prefix = "") {
  std::vector<ExrChannel> channels;
  const double rgb[] = {0.5, 0.2, 0.1};
  for (int c = 0; c < 3; ++c) {
    channels.push_back({prefix + "RGB"[c], Imf::FLOAT, [v = rgb[c] * alpha](int, int) { return v; }});
  }
  if (alpha != 1) channels.push_back({prefix + "A", Imf::FLOAT, [alpha](int, int) { return alpha; }});
  return channels;
}

Imf::Chromaticities chromaticities_of(const char* name) {
  for (const NamedPrimaries& known : named_primaries()) {
    const std::array<float, 8>& c = known.xy;
    if (std::string(known.name) == name) return {{c[0], c[1]}, {c[2], c[3]}, {c[4], c[5]}, {c[6], c[7]}};
  }
  return {};
}

class ExrColors : public ExrReader {
 protected:
  ExrColors() : header_(4, 2) {}

  void id(const std::string& text) { header_.insert("colorInteropID", Imf::StringAttribute(text)); }
  void flag(int value) { header_.insert("acesImageContainerFlag", Imf::IntAttribute(value)); }
  void primaries(const char* name) { Imf::addChromaticities(header_, chromaticities_of(name)); }
  void write(const std::vector<ExrChannel>& channels = light()) {
    write_scan_lines(path_, header_, channels);
  }

  // The name of the primaries as which the file is read: "assumed" if it names none.
  std::string read_as() {
    write();
    image_ = read();
    if (!image_.names_primaries) return "assumed";
    const NamedPrimaries* known = find_primaries(image_.chromaticities.value_or(kRec709.xy));
    return known != nullptr ? known->name : "others";
  }
  std::string notes() const {
    std::string all;
    for (const std::string& note : image_.notes) all += note + "\n";
    return all;
  }

  Imf::Header header_;
  Image image_;
};

TEST_F(ExrColors, TheFlagCountsBeforeTheIdAndTheIdBeforeChromaticities) {
  primaries("P3-D65");
  EXPECT_EQ(read_as(), "P3-D65");
  EXPECT_EQ(notes(), "");
  id("lin_ap1_scene");
  EXPECT_EQ(read_as(), "AP1");
  EXPECT_EQ(notes(),
            "its colorInteropID lin_ap1_scene counts, against its chromaticities (P3-D65 (Display P3))\n");
  flag(1);
  EXPECT_EQ(read_as(), "AP0");
  ASSERT_EQ(image_.notes.size(), 1u) << notes();
  EXPECT_TRUE(says(notes(), "acesImageContainerFlag 1 counts"));
  EXPECT_TRUE(says(notes(), "lin_ap1_scene (ACEScg (AP1))"));
  EXPECT_TRUE(says(notes(), "chromaticities (P3-D65"));
  flag(0);
  EXPECT_EQ(read_as(), "AP1");
}

TEST_F(ExrColors, StatementsThatAgreeNeedNoNote) {
  primaries("AP0");
  id("lin_ap0_scene");
  flag(1);
  EXPECT_EQ(read_as(), "AP0");
  EXPECT_EQ(notes(), "");
  header_ = Imf::Header(4, 2);
  primaries("AP1");
  id("srgb_ap1_scene");  // chromaticities say nothing about a curve
  EXPECT_EQ(read_as(), "AP1");
  EXPECT_EQ(notes(), "decoded from sRGB, as its colorInteropID srgb_ap1_scene says\n");
}

TEST_F(ExrColors, EveryNameOfSceneLightIsRead) {
  const std::map<std::string, std::string> linear = {
      {"lin_ap0_scene", "AP0"},       {"lin_ap1_scene", "AP1"},          {"lin_rec709_scene", "Rec.709"},
      {"lin_p3d65_scene", "P3-D65"},  {"lin_rec2020_scene", "Rec.2020"}, {"lin_adobergb_scene", "Adobe RGB"},
      {"lin_ciexyzd65_scene", "XYZ"}, {" LIN_AP1_SCENE ", "AP1"}};
  for (const auto& [name, expected] : linear) {
    id(name);
    EXPECT_EQ(read_as(), expected) << name;
    EXPECT_EQ(component(image_, 3, 1, 0), 0.5f) << name;
    EXPECT_EQ(notes(), "") << name;
  }
  const std::map<std::string, std::pair<std::string, double>> encoded = {
      {"srgb_rec709_scene", {"Rec.709", 0}},      {"srgb_ap1_scene", {"AP1", 0}},
      {"srgb_p3d65_scene", {"P3-D65", 0}},        {"g18_rec709_scene", {"Rec.709", 1.8}},
      {"g22_rec709_scene", {"Rec.709", 2.2}},     {"g22_ap1_scene", {"AP1", 2.2}},
      {"g22_adobergb_scene", {"Adobe RGB", 2.2}}, {"g24_rec709_scene", {"Rec.709", 2.4}}};
  for (const auto& [name, expected] : encoded) {
    id(name);
    EXPECT_EQ(read_as(), expected.first) << name;
    const double gamma = expected.second;
    for (int c = 0; c < 3; ++c) {
      const double v = c == 0 ? 0.5f : c == 1 ? 0.2f : 0.1f;
      const double light = gamma == 0 ? std::pow((v + 0.055) / 1.055, 2.4) : std::pow(v, gamma);
      EXPECT_NEAR(component(image_, 0, 0, c), light, 1e-7) << name;
    }
    ASSERT_EQ(image_.notes.size(), 1u) << notes();
  }
}

TEST_F(ExrColors, HalvesAreDecodedToFloatsSoThatNothingIsRoundedTwice) {
  id("srgb_rec709_scene");
  std::vector<ExrChannel> halves = light();
  for (ExrChannel& channel : halves) channel.type = Imf::HALF;
  write(halves);
  image_ = read();
  ASSERT_EQ(image_.format, ImageFormat::kRgba32f);
  ASSERT_EQ(image_.bytes(), image_.pixels.size());
  EXPECT_FLOAT_EQ(component(image_, 3, 1, 0), static_cast<float>(std::pow(0.555 / 1.055, 2.4)));
  // 4 x 2 pixels take 64 bytes as halves, and 128 as floats.
  EXPECT_TRUE(says(error({.max_bytes = 127}), "limit is 127 bytes"));
}

TEST_F(ExrColors, DecodingKeepsAssociatedColourAndAbsentPixelsAndOddValues) {
  id("srgb_rec709_scene");
  write(light(0.25));
  image_ = read();
  EXPECT_NEAR(component(image_, 0, 0, 0), 0.25 * 0.21404114, 1e-7);
  EXPECT_EQ(component(image_, 0, 0, 3), 0.25f);
  constexpr float kInf = std::numeric_limits<float>::infinity();
  for (const auto& [stored, expected] : {std::pair(0.0f, 0.0f), std::pair(-0.5f, -0.5f / 12.92f),
                                         std::pair(kInf, kInf), std::pair(-kInf, -kInf)}) {
    std::vector<ExrChannel> channels = light();
    channels[0].value = [stored = stored](int, int) { return stored; };
    write(channels);
    EXPECT_FLOAT_EQ(component(read(), 0, 0, 0), expected) << stored;
  }
  std::vector<ExrChannel> channels = light();
  channels[0].value = [](int, int) { return std::nan(""); };
  write(channels);
  EXPECT_TRUE(std::isnan(component(read(), 0, 0, 0)));
  id("g22_rec709_scene");
  channels[0].value = [](int, int) { return -0.5; };
  write(channels);
  EXPECT_NEAR(component(read(), 0, 0, 0), -std::pow(0.5, 2.2), 1e-7);
}

TEST_F(ExrColors, SignalsOfADisplayAreRefusedByName) {
  for (const std::string name :
       {"srgb_rec709_display", "g24_rec709_display", "srgb_p3d65_display", "pq_p3d65_display",
        "pq_rec2020_display", "hlg_rec2020_display", "g22_rec709_display", "g22_adobergb_display",
        "g26_p3d65_display", "g26_xyzd65_display", "pq_xyzd65_display", "srgbe_p3d65_display",
        "lin_rec709_display", "PQ_REC2020_scene"}) {
    id(name);
    write();
    const std::string refused = error();
    EXPECT_TRUE(says(refused, path_ + ": its colorInteropID is " + name));
    EXPECT_TRUE(says(refused, "--ocio-input"));
    ASSERT_OK_AND_ASSIGN(const auto facts, describe_image(path_));
    EXPECT_EQ(facts.renderable.code(), absl::StatusCode::kUnimplemented);
    EXPECT_EQ(facts.parts[0].color_interop_id, name);
    // The user may say what the values are.
    ASSERT_OK_AND_ASSIGN(const Image own, read_image(path_, {}, {.own_values = true}));
    EXPECT_EQ(component(own, 0, 0, 0), 0.5f);
    ASSERT_EQ(own.notes.size(), 1u);
  }
}

TEST_F(ExrColors, UnknownStatesNothingAndANameThatNobodyDefinesIsNoted) {
  primaries("AP1");
  id("unknown");
  EXPECT_EQ(read_as(), "AP1");
  EXPECT_EQ(notes(), "");
  for (const std::string name : {"ocio:acescct_ap1_scene", "studio:lin_ap0_scene", "studio:pq_show_display",
                                 "lin_ap2_scene", "ACEScg"}) {
    id(name);
    EXPECT_EQ(read_as(), "AP1") << name;
    ASSERT_EQ(image_.notes.size(), 1u) << notes();
    EXPECT_TRUE(says(notes(), "\"" + name + "\", is not used"));
  }
  id("\x1b[2J");
  EXPECT_EQ(read_as(), "AP1");
  EXPECT_TRUE(says(notes(), "\\x1b[2J"));
  header_ = Imf::Header(4, 2);
  id("unknown");
  EXPECT_EQ(read_as(), "assumed");
  id("");
  EXPECT_EQ(read_as(), "assumed");
  EXPECT_EQ(notes(), "");
}

TEST_F(ExrColors, AttributesOfAnotherTypeStateNothing) {
  header_.insert("colorInteropID", Imf::IntAttribute(1));
  header_.insert("acesImageContainerFlag", Imf::StringAttribute("1"));
  EXPECT_EQ(read_as(), "assumed");
}

TEST_F(ExrColors, DataIsNoPictureUnlessItIsChosen) {
  id("data");
  write();
  EXPECT_TRUE(says(error(), "its colorInteropID is data, so it holds numbers and no colours; --part 1"));
  ASSERT_OK_AND_ASSIGN(Image chosen, read_image(path_, {}, {.part = "1"}));
  EXPECT_EQ(component(chosen, 0, 0, 0), 0.5f);
  EXPECT_FALSE(chosen.names_primaries);
  ASSERT_EQ(chosen.notes.size(), 1u);
  EXPECT_OK(read_image(path_, {}, {.own_values = true}));

  // Of several parts, the first with colours is taken.
  std::vector<Imf::Header> headers;
  for (const char* name : {"normals", "beauty"}) {
    Imf::Header part(4, 2);
    part.setName(name);
    part.setType(Imf::SCANLINEIMAGE);
    part.insert("colorInteropID", Imf::StringAttribute(name[0] == 'n' ? "data" : "lin_ap1_scene"));
    headers.push_back(part);
  }
  {
    const ExrPixels normals(headers[0], rgb_channels()), beauty(headers[1], light());
    Imf::MultiPartOutputFile file(path_.c_str(), headers.data(), 2);
    for (int i = 0; i < 2; ++i) {
      Imf::OutputPart part(file, i);
      part.setFrameBuffer(i == 0 ? normals.frame() : beauty.frame());
      part.writePixels(2);
    }
  }
  image_ = read();
  EXPECT_EQ(component(image_, 0, 0, 0), 0.5f);
  EXPECT_STREQ(find_primaries(image_.chromaticities.value_or(kRec709.xy))->name, "AP1");
  EXPECT_OK(read_image(path_, {}, {.part = "normals"}));
}

TEST_F(ExrColors, AnAdoptedNeutralThatIsNotTheWhiteIsNoted) {
  Imf::addAdoptedNeutral(header_, {0.3127f, 0.3290f});
  EXPECT_EQ(read_as(), "assumed");
  EXPECT_EQ(notes(), "");
  Imf::addAdoptedNeutral(header_, {0.3457f, 0.3585f});
  read_as();
  EXPECT_EQ(notes(), "its adoptedNeutral, 0.3457 0.3585, is not used; --white-balance 5001 comes close\n");
  id("lin_ap0_scene");  // whose white is D60
  Imf::addAdoptedNeutral(header_, {0.3217f, 0.3378f});
  read_as();
  EXPECT_EQ(notes(), "");
  for (const float odd : {0.0f, -1.0f, 1e30f, std::numeric_limits<float>::quiet_NaN()}) {
    Imf::addAdoptedNeutral(header_, {odd, odd});
    read_as();
    ASSERT_EQ(image_.notes.size(), 1u) << odd;
    EXPECT_FALSE(says(notes(), "--white-balance"));
  }
}

TEST_F(ExrColors, WrittenLightNamesItsPrimaries) {
  for (const auto& [name, expected] :
       {std::pair("Rec.709", "lin_rec709_scene"), std::pair("AP1", "lin_ap1_scene"),
        std::pair("XYZ", "lin_ciexyzd65_scene"), std::pair("P3-DCI", "unknown")}) {
    Image image = *make_image(2, 2, ImageFormat::kRgba16f);
    const Imf::Chromaticities c = chromaticities_of(name);
    image.chromaticities = {c.red.x, c.red.y, c.green.x, c.green.y, c.blue.x, c.blue.y, c.white.x, c.white.y};
    ASSERT_OK(write_image(path_, image));
    ASSERT_OK_AND_ASSIGN(auto facts, describe_image(path_));
    EXPECT_EQ(facts.parts[0].color_interop_id, expected);
    EXPECT_EQ(facts.notes, std::vector<std::string>{});
  }
  const Image image = *make_image(2, 2, ImageFormat::kRgba16f);
  ASSERT_OK(write_image(path_, image, {.transfer = EncodedTransfer::kUnknown}));
  EXPECT_EQ(describe_image(path_)->parts[0].color_interop_id, "unknown");
  EXPECT_FALSE(read().names_primaries);
}

}  // namespace
}  // namespace candela
