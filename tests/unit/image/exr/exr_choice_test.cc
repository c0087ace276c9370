// Parts, layers and views of OpenEXR files: choosing one, and describing them.
#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfInputFile.h>
#include <OpenEXR/ImfInputPart.h>
#include <OpenEXR/ImfMultiPartInputFile.h>
#include <OpenEXR/ImfMultiPartOutputFile.h>
#include <OpenEXR/ImfOutputPart.h>
#include <OpenEXR/ImfPartType.h>
#include <OpenEXR/ImfRgbaFile.h>
#include <OpenEXR/ImfStandardAttributes.h>
#include <gtest/gtest.h>

#include "absl/strings/str_format.h"
#include "client/image/color.h"
#include "client/image/describe.h"
#include "tests/support/status.h"
#include "tests/unit/image/exr/exr_choice_fixture.h"

namespace candela {
namespace {

TEST_F(ExrChoice, TakesAPartByNameOrByNumber) {
  write_parts(path_, {{"rgba", "", colour("", 10)},
                      {"depth", "", {constant("Z", 5, Imf::FLOAT)}},
                      {"motion", "", {constant("forward.u", 1), constant("forward.v", 2)}},
                      {"beauty pass", "", colour("beauty.", 20)}});
  EXPECT_EQ(pixel({}), "10 11 12");
  EXPECT_EQ(pixel({.part = "rgba"}), "10 11 12");
  EXPECT_EQ(pixel({.part = "1"}), "10 11 12");
  EXPECT_EQ(pixel({.part = "depth"}), "5 5 5");
  EXPECT_EQ(pixel({.part = "4"}), "20 21 22");
  EXPECT_EQ(pixel({.part = "beauty pass"}), "20 21 22");
  for (const char* wrong : {"0", "5", "dept", "-1"}) {
    EXPECT_EQ(pixel({.part = wrong}),
              absl::StrFormat("there is no part \"%s\"; there are: 1 rgba, 2 depth, 3 motion, 4 beauty pass",
                              wrong));
  }
  EXPECT_TRUE(says(pixel({.part = "motion"}), "it has forward.u, forward.v"));
  EXPECT_EQ(pixel({.part = "motion", .layer = "forward.v"}), "2 2 2");
}

TEST_F(ExrChoice, TakesALayerAVectorOrASingleChannel) {
  write_scan_lines(path_, Imf::Header(5, 5),
                   all({colour("", 10),
                        colour("fill.key.", 30),
                        {constant("Z", 7, Imf::FLOAT), constant("mask.only", 9)},
                        {constant("N.X", 1), constant("N.Y", 2), constant("N.Z", 3)}}));
  EXPECT_EQ(pixel({}), "10 11 12");
  EXPECT_EQ(pixel({.layer = "fill.key"}), "30 31 32");
  EXPECT_EQ(pixel({.layer = "N"}), "1 2 3");
  EXPECT_EQ(pixel({.layer = "mask"}), "9 9 9");
  EXPECT_EQ(pixel({.layer = "Z"}), "7 7 7");
  EXPECT_EQ(pixel({.layer = "fill.key.G"}), "31 31 31");
  EXPECT_EQ(pixel({.layer = "fil"}), "there is no layer \"fil\"; there are: N, fill.key, mask, B, G, R, Z");
  EXPECT_EQ(pixel({.view = "left"}), "there is no view \"left\"; the file names no views");
  EXPECT_TRUE(read_image(path_, {}, {.layer = "N"})->notes.empty());
}

TEST_F(ExrChoice, TakesAViewOfOnePartOrOfSeveral) {
  Imf::Header header(5, 5);
  Imf::addMultiView(header, {"left", "right"});
  write_scan_lines(
      path_, header,
      all({colour("", 10), colour("right.", 20), colour("spec.", 30), colour("spec.right.", 40)}));
  EXPECT_EQ(pixel({}), "10 11 12");
  EXPECT_EQ(pixel({.view = "left"}), "10 11 12");
  EXPECT_EQ(pixel({.view = "right"}), "20 21 22");
  EXPECT_EQ(pixel({.layer = "spec", .view = "right"}), "40 41 42");
  EXPECT_EQ(pixel({.layer = "right"}), "20 21 22");
  EXPECT_EQ(pixel({.view = "middle"}), "there is no view \"middle\"; there are: left, right");

  write_parts(path_, {{"rgba_r", "right", colour("", 50)}, {"rgba_l", "left", colour("", 60)}});
  EXPECT_EQ(pixel({}), "50 51 52");
  EXPECT_EQ(pixel({.view = "left"}), "60 61 62");
  EXPECT_EQ(pixel({.part = "rgba_r", .view = "left"}), "there is no view \"left\"; there are: right");
}

TEST_F(ExrChoice, KeepsTheLimitsForEveryChoice) {
  std::vector<ExrChannel> channels = colour("", 1);
  channels.push_back(constant("Z", 2, Imf::FLOAT));
  write_scan_lines(path_, Imf::Header(64, 64), channels);
  const ImageLimits limits{.max_bytes = 64 * 64 * 8};  // enough for halves only
  EXPECT_OK(read_image(path_, limits));
  EXPECT_EQ(read_image(path_, limits, {.layer = "Z"}).status().code(), absl::StatusCode::kResourceExhausted);
}

// Copies single-part files as they are into the parts of one file.
void join(const std::string& path, const std::vector<std::string>& files) {
  std::vector<Imf::Header> headers;
  for (const std::string& file : files) {
    headers.push_back(Imf::MultiPartInputFile(file.c_str()).header(0));
    headers.back().setName("part_" + std::to_string(headers.size()));
    headers.back().setType(Imf::SCANLINEIMAGE);
  }
  Imf::MultiPartOutputFile out(path.c_str(), headers.data(), static_cast<int>(headers.size()));
  for (int i = 0; i < static_cast<int>(files.size()); ++i) {
    Imf::MultiPartInputFile in(files[i].c_str());
    Imf::InputPart input(in, 0);
    Imf::OutputPart(out, i).copyPixels(input);
  }
}

TEST_F(ExrChoice, DecodesLuminanceAndChromaInAnyPart) {
  const std::string plain = folder_.path("plain.exr"), luma = folder_.path("luma.exr");
  const Imath::Box2i display(Imath::V2i(0, 0), Imath::V2i(39, 29)),
      data(Imath::V2i(-4, 2), Imath::V2i(51, 25));
  const int width = 56, height = 24;
  std::vector<Imf::Rgba> pixels(static_cast<size_t>(width) * height);
  for (int i = 0; i < width * height; ++i) {
    const float v = 1 + 0.01f * static_cast<float>(i % width);
    pixels[i] = Imf::Rgba(v, 0.9f * v, 0.8f * v);
  }
  Imf::Header header(display, data);
  Imf::addChromaticities(header, {{0.713f, 0.293f}, {0.165f, 0.83f}, {0.128f, 0.044f}, {0.32168f, 0.33767f}});
  {
    Imf::RgbaOutputFile file(luma.c_str(), header, Imf::WRITE_YCA);
    file.setFrameBuffer(pixels.data() - data.min.x - std::ptrdiff_t{data.min.y} * width, 1, width);
    file.writePixels(height);
  }
  write_scan_lines(plain, header, colour("", 10));  // parts share the window and the chromaticities
  join(path_, {plain, luma});
  ASSERT_OK_AND_ASSIGN(const Image alone, read_image(luma));
  ASSERT_OK_AND_ASSIGN(const Image second, read_image(path_, {}, {.part = "2"}));
  EXPECT_TRUE(same_pixels(alone, second));
  EXPECT_EQ(alone.chromaticities, second.chromaticities);
  EXPECT_TRUE(second.has_alpha);
  EXPECT_NEAR(component(second, 20, 10, 0), 1.24, 0.02);
  EXPECT_NEAR(component(second, 20, 10, 2), 0.8 * 1.24, 0.02);
}

TEST_F(ExrChoice, IsOnlyForOpenExr) {
  write_file(path_, "PF\n1 1\n-1.0\n" + std::string(12, '\0'));
  EXPECT_OK(read_image(path_));
  EXPECT_REFUSED(kInvalidArgument, "this is a PFM file with one picture",
                 read_image(path_, {}, {.layer = "beauty"}));
}

TEST_F(ExrChoice, IsDescribedWithEverythingThatThereIs) {
  Imf::Header header(Imath::Box2i({0, 0}, {9, 4}), Imath::Box2i({1, 1}, {3, 3}), 2.0f);
  Imf::addChromaticities(header, {{0.713f, 0.293f}, {0.165f, 0.83f}, {0.128f, 0.044f}, {0.32168f, 0.33767f}});
  Imf::addFramesPerSecond(header, Imf::Rational(24000, 1001));
  Imf::addMultiView(header, {"left", "right"});
  header.compression() = Imf::PIZ_COMPRESSION;
  write_scan_lines(path_, header,
                   all({colour("", 1), colour("right.", 1), {constant("depth.Z", 1, Imf::FLOAT)}}));
  ASSERT_OK_AND_ASSIGN(const FileFacts facts, describe_image(path_));
  EXPECT_EQ(facts.kind, "OpenEXR");
  EXPECT_EQ(facts.shown, "R G B");
  ASSERT_EQ(facts.parts.size(), 1u);
  const PartFacts& part = facts.parts[0];
  EXPECT_EQ(part.storage, "scan lines");
  EXPECT_EQ(part.compression, "PIZ");
  EXPECT_EQ(part.display.right, 9);
  EXPECT_EQ(part.data.left, 1);
  EXPECT_EQ(part.pixel_aspect, 2);
  EXPECT_NEAR(part.frames_per_second, 23.976, 1e-3);
  EXPECT_EQ(part.views, (std::vector<std::string>{"left", "right"}));
  EXPECT_EQ(part.layers, std::vector<std::string>{"depth"});
  ASSERT_EQ(part.channels.size(), 7u);
  EXPECT_EQ(part.channels[3].name, "depth.Z");
  EXPECT_EQ(part.channels[3].type, "float");
  ASSERT_TRUE(part.chromaticities.has_value());
  ASSERT_NE(find_primaries(*part.chromaticities), nullptr);
  EXPECT_STREQ(find_primaries(*part.chromaticities)->known_as, "ACEScg (AP1)");
}

TEST_F(ExrChoice, SaysWhyNothingIsRendered) {
  write_deep(path_);
  ASSERT_OK_AND_ASSIGN(FileFacts facts, describe_image(path_));
  EXPECT_EQ(facts.renderable.code(), absl::StatusCode::kUnimplemented);
  EXPECT_EQ(facts.parts[0].storage.substr(0, 4), "deep");
  write_scan_lines(path_, Imf::Header(100, 5), colour("", 1));
  ASSERT_OK_AND_ASSIGN(facts, describe_image(path_, {.max_dimension = 64}));
  EXPECT_EQ(facts.renderable.code(), absl::StatusCode::kResourceExhausted);
  write_file(path_, "PF\n3 2\n-1.0\n" + std::string(72, '\0'));
  ASSERT_OK_AND_ASSIGN(facts, describe_image(path_));
  EXPECT_EQ(facts.kind, "PFM");
  EXPECT_EQ(facts.parts[0].display.right, 2);
  EXPECT_FALSE(facts.parts[0].chromaticities.has_value());
}

TEST_F(ExrChoice, ReadsWhetherTheFileNamesItsPrimaries) {
  Imf::Header header(2, 2);
  write_scan_lines(path_, header, rgb_channels());
  EXPECT_FALSE(read().names_primaries);
  Imf::addChromaticities(header, Imf::Chromaticities());  // Rec.709 in words
  write_scan_lines(path_, header, rgb_channels());
  EXPECT_TRUE(read().names_primaries);
  EXPECT_FALSE(read().chromaticities.has_value());
  Imf::addChromaticities(header, Imf::Chromaticities({0, 0}, {0, 0}, {0, 0}, {0, 0}));  // singular
  write_scan_lines(path_, header, rgb_channels());
  EXPECT_FALSE(read().names_primaries);
}

TEST(Primaries, AreFoundByTheirNumbers) {
  for (const NamedPrimaries& known : named_primaries()) {
    std::array<float, 8> xy = known.xy;
    xy[2] += 0.0004f;
    ASSERT_NE(find_primaries(xy), nullptr) << known.name;
    EXPECT_STREQ(find_primaries(xy)->name, known.name);
    xy[2] += 0.0004f;
    EXPECT_EQ(find_primaries(xy), nullptr) << known.name;
  }
}

}  // namespace
}  // namespace candela
