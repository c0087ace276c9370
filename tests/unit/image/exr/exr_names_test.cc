// What the names of parts, layers and channels in OpenEXR files mean, and how messages show them.
#include <gtest/gtest.h>

#include <algorithm>
#include <utility>

#include "client/image/color.h"
#include "client/image/describe.h"
#include "tests/support/status.h"
#include "tests/unit/image/exr/exr_choice_fixture.h"

namespace candela {
namespace {

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
