// OpenEXR files with several parts and layers.
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

#include <algorithm>
#include <initializer_list>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_format.h"
#include "client/image/color.h"
#include "client/image/describe.h"
#include "tests/support/status.h"
#include "tests/unit/image/exr_reader_fixture.h"

namespace candela {
namespace {

ExrChannel constant(const std::string& name, double value, Imf::PixelType type = Imf::HALF) {
  return {name, type, [value](int, int) { return value; }};
}

std::vector<ExrChannel> colour(const std::string& prefix, double value) {
  return {constant(prefix + "R", value), constant(prefix + "G", value + 1),
          constant(prefix + "B", value + 2)};
}

std::vector<ExrChannel> all(std::initializer_list<std::vector<ExrChannel>> lists) {
  std::vector<ExrChannel> channels;
  for (const auto& list : lists) channels.insert(channels.end(), list.begin(), list.end());
  return channels;
}

struct TestPart {
  std::string name, view;
  std::vector<ExrChannel> channels;
};

void write_parts(const std::string& path, const std::vector<TestPart>& parts) {
  std::vector<Imf::Header> headers;
  std::vector<ExrPixels> pixels;
  for (const TestPart& part : parts) {
    Imf::Header& header = headers.emplace_back(6, 4);
    header.setName(part.name);
    header.setType(Imf::SCANLINEIMAGE);
    if (!part.view.empty()) header.setView(part.view);
    pixels.emplace_back(header, part.channels);
  }
  Imf::MultiPartOutputFile file(path.c_str(), headers.data(), static_cast<int>(headers.size()));
  for (int i = 0; i < static_cast<int>(parts.size()); ++i) {
    Imf::OutputPart part(file, i);
    part.setFrameBuffer(pixels[i].frame());
    part.writePixels(4);
  }
}

// As colour(), with other names for the components.
std::vector<ExrChannel> named(const std::vector<std::string>& names, double value) {
  std::vector<ExrChannel> channels;
  for (const std::string& name : names) channels.push_back(constant(name, value++));
  return channels;
}

class ExrChoice : public ExrReader {
 protected:
  // The first pixel's red, green and blue, or the error.
  std::string pixel(const PictureChoice& choice) {
    const absl::StatusOr<Image> image = read_image(path_, {}, choice);
    if (!image.ok()) return std::string(image.status().message()).substr(path_.size() + 2);
    return absl::StrFormat("%g %g %g", component(*image, 0, 0, 0), component(*image, 0, 0, 1),
                           component(*image, 0, 0, 2));
  }
};

// Parts, layers and views of OpenEXR files: choosing one, and describing them.

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

// What the names of parts, layers and channels in OpenEXR files mean, and how messages show them.

TEST_F(ExrChoice, ReadsTheNamesOfColoursInAnyCaseAndInFull) {
  for (const std::string prefix : {"", "beauty.", "Ci.", "ViewLayer.Combined.", "."}) {
    for (const std::vector<std::string>& names :
         std::vector<std::vector<std::string>>{{"r", "g", "b", "a"},
                                               {"red", "green", "blue", "alpha"},
                                               {"Red", "Green", "Blue", "Alpha"},
                                               {"R", "g", "BLUE", "a"}}) {
      std::vector<std::string> full;
      for (const std::string& name : names) full.push_back(prefix + name);
      write_scan_lines(path_, Imf::Header(3, 3), named(full, 10));
      EXPECT_EQ(pixel({}), "10 11 12") << prefix << names[0];
      EXPECT_EQ(component(read(), 0, 0, 3), 13) << prefix << names[0];
    }
  }
  // Capitals come before small letters, and letters before words.
  write_scan_lines(path_, Imf::Header(3, 3),
                   all({colour("", 10), named({"r", "g", "b"}, 20), named({"red", "green", "blue"}, 30)}));
  EXPECT_EQ(pixel({}), "10 11 12");
  EXPECT_EQ(pixel({.layer = "g"}), "21 21 21");
}

TEST_F(ExrChoice, TakesTheLayerWhoseNameMeansThePicture) {
  const std::vector<std::pair<std::string, std::string>> better = {
      {"Main.Combined", "Main.AOV"},
      {"rgba", "AO"},
      {"Beauty", "Albedo"},
      {"C", "N"},
      {"Ci", "Alpha_mask"},
      {"colour", "albedo"},
      {"RGB_color", "DiffuseFilter"},
      {"Zebra", "Depth"},
      {"zoo", "CryptoObject00"},
      {"ViewLayer.Combined", "View.Noisy Image"},
      {"specular", "UVPass"},
      {"reflect", "P"},
      {"volume", "Position"},
      {"wall", "denoising.Normal"},
      {"zeta", "N.dot"},
      {"zoom", "IndexOB"},
  };
  for (const auto& [good, other] : better) {
    write_scan_lines(path_, Imf::Header(3, 3), all({colour(good + ".", 10), colour(other + ".", 20)}));
    EXPECT_EQ(pixel({}), "10 11 12") << good << " before " << other;
    write_parts(path_, {{other, "", colour("", 20)}, {good, "", colour("", 10)}});
    EXPECT_EQ(pixel({}), "10 11 12") << "parts, " << good << " before " << other;
    write_scan_lines(path_, Imf::Header(3, 3), all({colour(good + ".", 20), colour("", 10)}));
    EXPECT_EQ(pixel({}), "10 11 12") << "no name before " << good;
  }
}

// https://github.com/Tom94/tev/issues/68 (pbrt's LeR) and others
TEST_F(ExrChoice, ColoursNeedNoDotInTheirNames) {
  write_scan_lines(
      path_, Imf::Header(3, 3),
      all({named({"LeR", "LeG", "LeB"}, 10), named({"beauty_r", "beauty_g", "beauty_b", "beauty_a"}, 20),
           named({"AR", "AG", "AB"}, 30), named({"spec.keyR", "spec.keyG", "spec.keyB"}, 40)}));
  EXPECT_EQ(pixel({}), "20 21 22");
  EXPECT_EQ(pixel({.layer = "Le"}), "10 11 12");
  EXPECT_EQ(pixel({.layer = "beauty"}), "20 21 22");
  EXPECT_EQ(pixel({.layer = "spec.key"}), "40 41 42");
  EXPECT_EQ(pixel({.layer = "LeG"}), "11 11 11");
  EXPECT_EQ(pixel({.layer = "A"}).find("there is no layer"), 0u);
}

// https://github.com/Tom94/tev/issues/304
TEST_F(ExrChoice, ThreeChannelsOfAnyNamesAreShownIfTheyAreChosen) {
  write_scan_lines(path_, Imf::Header(3, 3), all({colour("", 1), named({"flow.U", "flow.V", "flow.W"}, 10)}));
  EXPECT_EQ(pixel({}), "1 2 3");
  EXPECT_EQ(pixel({.layer = "flow"}), "10 11 12");
  write_scan_lines(path_, Imf::Header(3, 3), named({"U", "V", "W"}, 10));
  EXPECT_EQ(pixel({.part = "1"}), "10 11 12");
}

// https://github.com/Tom94/tev/issues/168
TEST_F(ExrChoice, ADotBeforeTheNameIsNoLayer) {
  write_scan_lines(path_, Imf::Header(3, 3),
                   all({colour(".", 1), named({".A"}, 4), named({".Z"}, 5), colour("VRayDiffuse.", 10)}));
  EXPECT_EQ(pixel({}), "1 2 3");
  EXPECT_EQ(pixel({.layer = "RGBA"}), "1 2 3");
  EXPECT_EQ(pixel({.layer = "VRayDiffuse"}), "10 11 12");
}

TEST_F(ExrChoice, TakesTheDefaultViewOfThePicture) {
  write_parts(path_, {{"depth.left", "left", colour("", 10)},
                      {"rgba.right", "right", colour("", 20)},
                      {"rgba.left", "left", colour("", 30)}});
  EXPECT_EQ(pixel({}), "30 31 32");
  EXPECT_EQ(pixel({.view = "right"}), "20 21 22");
}

TEST_F(ExrChoice, ShowsXyzWithoutALayerOnlyWhenItIsChosen) {
  write_scan_lines(path_, Imf::Header(3, 3), named({"X", "Y", "Z"}, 1));
  EXPECT_TRUE(says(pixel({}), "no colour channels (it has XYZ, X, Y, Z)"));
  ASSERT_OK_AND_ASSIGN(const Image image, read_image(path_, {}, {.layer = "XYZ"}));
  EXPECT_EQ(component(image, 0, 0, 1), 2);
  ASSERT_TRUE(image.chromaticities.has_value());
  EXPECT_EQ(image.chromaticities, kXyz.xy);
  EXPECT_EQ(image.notes, std::vector<std::string>{"X, Y and Z are taken as CIE XYZ"});
  write_scan_lines(path_, Imf::Header(3, 3), all({named({"X", "Y", "Z"}, 1), colour("beauty.", 10)}));
  EXPECT_EQ(pixel({}), "10 11 12");
  EXPECT_EQ(read().notes, std::vector<std::string>{"layer beauty is shown; there is also --layer XYZ"});
}

// The options in a note or an error, as a shell would read them.
std::vector<PictureChoice> choices_in(const std::string& words) {
  std::vector<PictureChoice> choices;
  size_t at = 0;
  const auto value = [&](const std::string& option) {
    std::string text;
    if (words.compare(at, option.size(), option) != 0) return text;
    at += option.size() + 1;
    for (bool within = false; at < words.size(); ++at) {
      const char c = words[at];
      if (c == '\'') {
        within = !within;
      } else if (c == '\\' && !within) {
        text += words[++at];
      } else if (!within && (c == ' ' || c == ',')) {
        break;
      } else {
        text += c;
      }
    }
    return text;
  };
  while ((at = words.find("--", at)) != std::string::npos) {
    PictureChoice choice;
    choice.part = value("--part");
    if (!choice.part.empty() && words.compare(at, 3, " --") == 0) ++at;
    choice.layer = value("--layer");
    if (!choice.empty()) choices.push_back(choice);
    at = choice.empty() ? at + 2 : at;
  }
  return choices;
}

TEST_F(ExrChoice, EveryNameThatIsShownCanBePassedBack) {
  const std::string odd = "a\x01 'b'\xff,c";
  const std::vector<std::string> names = {"Gl\xc3\xbchen", "Noisy Image", odd, "\xe7\x85\xa7\xe6\x98\x8e",
                                          "-dash",         "it's",        "2", std::string(200, 'n')};
  std::vector<ExrChannel> channels =
      all({colour("", 1), named({"depth.Z"}, 7), named({"N.x", "N.y", "N.z"}, 8)});
  std::vector<TestPart> parts = {{"depth", "", {constant("Z", 5)}}, {"two", "", colour("one.", 2)}};
  parts.back().channels.push_back(constant("two.Y", 7));
  double value = 100;
  for (const std::string& name : names) {
    for (const ExrChannel& channel : colour(name + ".", value)) channels.push_back(channel);
    parts.push_back({name, "", colour("", value)});
    value += 10;
  }
  for (const bool in_parts : {false, true}) {
    if (in_parts) {
      write_parts(path_, parts);
    } else {
      write_scan_lines(path_, Imf::Header(3, 3), channels);
    }
    const Image image = read();
    ASSERT_EQ(image.notes.size(), 1u);
    const std::vector<PictureChoice> advised = choices_in(image.notes[0]);
    EXPECT_EQ(advised.size(), 8u) << image.notes[0];
    std::vector<std::string> seen = {pixel({})};
    for (const PictureChoice& choice : advised) {
      const std::string shown = pixel(choice);
      EXPECT_FALSE(says(shown, "there is no"));
      EXPECT_EQ(std::count(seen.begin(), seen.end(), shown), 0) << choice.part << " " << choice.layer;
      seen.push_back(shown);
    }
    ASSERT_OK_AND_ASSIGN(const FileFacts facts, describe_image(path_));
    for (const PartFacts& part : facts.parts) {
      EXPECT_TRUE(!in_parts || read_image(path_, {}, {.part = part.name}).ok()) << part.name;
      for (const std::string& layer : part.layers) {
        EXPECT_OK(read_image(path_, {}, {.layer = layer})) << layer;
      }
      for (const ChannelFacts& channel : part.channels) {
        EXPECT_OK(read_image(path_, {}, {.layer = channel.name})) << channel.name;
      }
    }
  }
  // Those that the error lists, too.
  const std::string error = pixel({.part = "no such"});
  EXPECT_TRUE(says(error, ", 3 Gl\xc3\xbchen, 4 Noisy Image, 5 a\\x01 'b'\\xff,c"));
  EXPECT_EQ(pixel({.part = "5 a\\x01 'b'\\xff,c"}), "120 121 122");
}

}  // namespace
}  // namespace candela
