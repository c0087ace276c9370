#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "absl/strings/str_cat.h"
#include "tests/support/files.h"
#include "tests/support/status.h"
#include "tests/unit/image/image_support.h"

namespace candela {
namespace {

using Rgbe = std::array<uint8_t, 4>;

class RadianceReader : public ::testing::Test {
 protected:
  TemporaryFolder folder_;
  const std::string path_ = folder_.path("in.hdr");

  absl::StatusOr<Image> read(const std::string& header, const std::string& pixels,
                             const ImageLimits& limits = {}) {
    write_file(path_, header + pixels);
    return read_image(path_, limits);
  }
  Image good(const std::string& header, const std::string& pixels) {
    absl::StatusOr<Image> image = read(header, pixels);
    EXPECT_OK(image);
    return image.ok() ? *std::move(image) : Image{};
  }
  std::string error(const std::string& header, const std::string& pixels) {
    absl::StatusOr<Image> image = read(header, pixels);
    if (image.ok()) return "read";
    EXPECT_EQ(image.status().code(), absl::StatusCode::kInvalidArgument);
    return std::string(image.status().message());
  }
};

std::string header(const std::string& lines, const std::string& size) {
  return absl::StrCat("#?RADIANCE\n", lines, "FORMAT=32-bit_rle_rgbe\n\n", size, "\n");
}

std::string bytes(std::initializer_list<int> values) {
  std::string text;
  for (int v : values) text.push_back(static_cast<char>(v));
  return text;
}

// A pixel that encodes its position. The mantissas are x + 1 and y + 1 at exponent 136, so that the values
// are these numbers.
Rgbe marked(int x, int y) { return {static_cast<uint8_t>(x + 1), static_cast<uint8_t>(y + 1), 77, 136}; }

std::string flat(std::span<const Rgbe> pixels) {
  std::string text;
  for (const Rgbe& p : pixels) text.append(p.begin(), p.end());
  return text;
}

std::string by_component(std::span<const Rgbe> line) {
  std::string text = bytes({2, 2, static_cast<int>(line.size() / 256), static_cast<int>(line.size() % 256)});
  for (int c = 0; c < 4; ++c) {
    for (size_t i = 0; i < line.size();) {
      size_t run = 1;
      while (run < 127 && i + run < line.size() && line[i + run][c] == line[i][c]) ++run;
      text.push_back(static_cast<char>(run > 1 ? 128 + run : 1));
      text.push_back(static_cast<char>(line[i][c]));
      i += run;
    }
  }
  return text;
}

std::vector<Rgbe> marked_line(int width, int y) {
  std::vector<Rgbe> line;
  for (int x = 0; x < width; ++x) line.push_back(marked(x, y));
  return line;
}

// Radiance's own programs read any text before an empty line that has a FORMAT.
TEST_F(RadianceReader, TextMayStandBeforeItsKind) {
  const std::string rest = "FORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 1\n";
  const std::string pixel = bytes({128, 64, 32, 129});
  for (const std::string& before :
       {std::string("#?RADIANCE\n"), std::string("\n#?RADIANCE\n"), std::string("Photo by me\n\r\n#?RGBE\n"),
        std::string("# caf\xc3\xa9\n\n"), std::string()}) {
    EXPECT_EQ(component(good(before + rest, pixel), 0, 0, 0), 1) << before;
  }
  EXPECT_EQ(component(good("EXPOSURE=2\n#?RADIANCE\n" + rest, pixel), 0, 0, 0), 0.5);
  for (const std::string& before :
       {std::string("\0\n#?RADIANCE\n", 13), std::string(300, ' ') + "\n#?RADIANCE\n",
        std::string("x#?RADIANCE\nFORM=\n")}) {
    EXPECT_TRUE(says(error(before + "\n-Y 1 +X 1\n", pixel), "not an OpenEXR, Radiance, PFM, PNG")) << before;
  }
}

TEST_F(RadianceReader, ScalesByTheExponentWithoutTheHalf) {
  const Image image = good(header("", "-Y 1 +X 4"),
                           bytes({128, 64, 32, 129, 255, 1, 0, 255, 200, 100, 50, 0, 255, 254, 253, 1}));
  EXPECT_EQ(image.format, ImageFormat::kRgba32f);
  EXPECT_FALSE(image.has_alpha);
  EXPECT_EQ(component(image, 0, 0, 0), 1.0f);
  EXPECT_EQ(component(image, 0, 0, 1), 0.5f);
  EXPECT_EQ(component(image, 0, 0, 2), 0.25f);
  EXPECT_EQ(component(image, 0, 0, 3), 1.0f);
  EXPECT_EQ(component(image, 1, 0, 0), std::ldexp(255.0f, 119));  // the largest
  EXPECT_EQ(component(image, 2, 0, 0), 0.0f);                     // exponent 0 is black
  EXPECT_EQ(component(image, 3, 0, 0), std::ldexp(255.0f, -135));
}

TEST_F(RadianceReader, ReadsTheThreeCodingsAlike) {
  std::vector<Rgbe> line(600, marked(3, 1));
  for (int i = 0; i < 40; ++i) line[5 + i] = marked(i, 9);
  const Image plain = good(header("", "-Y 1 +X 600"), flat(line));
  EXPECT_TRUE(same_pixels(plain, good(header("", "-Y 1 +X 600"), by_component(line))));
  // 555 = 0x22b repetitions: the low byte comes first, then the next one.
  const std::string old = flat(std::span(line).first(45)) + flat(std::span(line).subspan(45, 1)) +
                          bytes({1, 1, 1, 554 & 255, 1, 1, 1, 554 >> 8});
  EXPECT_TRUE(same_pixels(plain, good(header("", "-Y 1 +X 600"), old)));
}

TEST_F(RadianceReader, TurnsAllEightOrientationsUpright) {
  constexpr int kWidth = 9, kHeight = 11;
  for (const bool columns : {false, true}) {
    for (const char x_sign : {'+', '-'}) {
      for (const char y_sign : {'+', '-'}) {
        const std::string x_axis = absl::StrCat(std::string(1, x_sign), "X ", kWidth);
        const std::string y_axis = absl::StrCat(std::string(1, y_sign), "Y ", kHeight);
        const std::string size = columns ? x_axis + " " + y_axis : y_axis + " " + x_axis;
        std::string pixels;
        for (int i = 0; i < (columns ? kWidth : kHeight); ++i) {
          std::vector<Rgbe> line;
          for (int k = 0; k < (columns ? kHeight : kWidth); ++k) {
            const int x = columns ? i : k, y = columns ? k : i;
            line.push_back(marked(x_sign == '+' ? x : kWidth - 1 - x, y_sign == '-' ? y : kHeight - 1 - y));
          }
          pixels += by_component(line);
        }
        const Image image = good(header("", size), pixels);
        ASSERT_EQ(image.width, static_cast<uint32_t>(kWidth)) << size;
        ASSERT_EQ(image.height, static_cast<uint32_t>(kHeight)) << size;
        for (int y = 0; y < kHeight; ++y) {
          for (int x = 0; x < kWidth; ++x) {
            ASSERT_EQ(component(image, x, y, 0), x + 1) << size;
            ASSERT_EQ(component(image, x, y, 1), y + 1) << size;
          }
        }
      }
    }
  }
}

TEST_F(RadianceReader, DividesTheProductOfExposuresOutAndSaysSo) {
  const Image image =
      good(header("EXPOSURE=2.0\n# comment\nEXPOSURE= 0.25\n", "-Y 1 +X 1"), bytes({128, 0, 0, 129}));
  EXPECT_EQ(component(image, 0, 0, 0), 2.0f);
  EXPECT_EQ(image.notes, std::vector<std::string>{"EXPOSURE 0.5 divided out"});
  for (const char* useless : {"0", "-1", "inf", "nan"}) {
    const Image ignored =
        good(header(absl::StrCat("EXPOSURE=", useless, "\n"), "-Y 1 +X 1"), bytes({128, 0, 0, 129}));
    EXPECT_EQ(component(ignored, 0, 0, 0), 1.0f);
    EXPECT_EQ(ignored.notes.size(), 1u);
  }
}

TEST_F(RadianceReader, ReadsNumbersAsAtofDoes) {
  for (const char* two : {"2.0 # f/8", " 2", "+2", "2e0x", "2.", "\t2.000 3"}) {
    const Image image =
        good(header(absl::StrCat("EXPOSURE=", two, "\n"), "-Y 1 +X 1"), bytes({128, 0, 0, 129}));
    EXPECT_EQ(component(image, 0, 0, 0), 0.5f) << two;
    EXPECT_EQ(image.notes, std::vector<std::string>{"EXPOSURE 2 divided out"}) << two;
  }
  const Image wide = good(header("PIXASPECT=0.5 wide\n", "-Y 1 +X 1"), bytes({128, 0, 0, 129}));
  EXPECT_EQ(wide.pixel_aspect, 2);
  const Image none = good(header("EXPOSURE=f/8\n", "-Y 1 +X 1"), bytes({128, 0, 0, 129}));
  EXPECT_EQ(component(none, 0, 0, 0), 1.0f);
  EXPECT_EQ(none.notes, std::vector<std::string>{"EXPOSURE f/8 is no number and was ignored"});
}

TEST_F(RadianceReader, IgnoresAGammaAndSaysSo) {
  const Image image = good(header("GAMMA=2.2\n", "-Y 1 +X 1"), bytes({128, 0, 0, 129}));
  EXPECT_EQ(component(image, 0, 0, 0), 1.0f);
  EXPECT_EQ(image.notes,
            std::vector<std::string>{"GAMMA 2.2 was ignored: a Radiance file holds linear light"});
  EXPECT_TRUE(good(header("GAMMA=1.0\n", "-Y 1 +X 1"), bytes({128, 0, 0, 129})).notes.empty());
}

TEST_F(RadianceReader, FillsWhatAnUnfinishedFileLacks) {
  for (const char* size : {"-Y 4 +X 40", "+Y 4 +X 40"}) {
    std::string whole = header("", size);
    for (int y = 0; y < 3; ++y) whole += by_component(marked_line(40, y));
    write_file(path_, whole);
    const absl::Status refused = read_image(path_).status();
    EXPECT_TRUE(says(refused.message(), "--incomplete fill renders what is there"));
    ASSERT_OK_AND_ASSIGN(const Image image, read_image(path_, {}, {.fills_gaps = true}));
    EXPECT_EQ(image.missing_pixels, 40u);
    EXPECT_TRUE(image.has_alpha);
    const uint32_t missing = size[0] == '-' ? 3 : 0;
    for (uint32_t y = 0; y < 4; ++y) EXPECT_EQ(component(image, 7, y, 3), y == missing ? 0 : 1);
    EXPECT_TRUE(says(image.notes.at(0), "40 of its 160 pixels are missing"));
  }
}

TEST_F(RadianceReader, AZeroStaysZeroWhateverTheExposure) {
  const Image image = good(header("EXPOSURE=1e-29\n", "-Y 1 +X 1"), bytes({1, 0, 0, 255}));
  EXPECT_GT(component(image, 0, 0, 0), 3e38f);
  EXPECT_EQ(component(image, 0, 0, 1), 0.0f);
}

TEST_F(RadianceReader, HonoursPrimariesAndPixelAspectAndReportsColourCorrection) {
  const std::string lines =
      "PRIMARIES=0.64 0.33 0.29 0.60 0.15 0.06 0.3333 0.3333\nPIXASPECT=0.5\nCOLORCORR=1 2 3\n";
  const Image image = good(header(lines, "-Y 1 +X 1"), bytes({1, 2, 3, 128}));
  const std::array<float, 8> primaries{0.64f, 0.33f, 0.29f, 0.60f, 0.15f, 0.06f, 0.3333f, 0.3333f};
  EXPECT_EQ(image.chromaticities, primaries);
  EXPECT_EQ(image.pixel_aspect, 2.0);  // the file's is height over width
  EXPECT_EQ(image.notes, std::vector<std::string>{"COLORCORR 1 2 3 was not divided out"});

  const Image flat = good(header("PRIMARIES=0 0 0 0 0 0 0.3 0.3\n", "-Y 1 +X 1"), bytes({1, 2, 3, 128}));
  EXPECT_FALSE(flat.chromaticities.has_value());
  EXPECT_EQ(flat.notes.size(), 1u);
  // As Poly Haven's files have them: they name none.
  const Image zeros = good(header("PRIMARIES=0 0 0 0 0 0 0 0\n", "-Y 1 +X 1"), bytes({1, 2, 3, 128}));
  EXPECT_FALSE(zeros.chromaticities.has_value());
  EXPECT_FALSE(zeros.names_primaries);
  EXPECT_TRUE(zeros.notes.empty());
}

TEST_F(RadianceReader, TextOfAFileCannotCommandATerminal) {
  const Image image = good(header("COLORCORR=\x1b[2J\xff\n", "-Y 1 +X 1"), bytes({1, 2, 3, 128}));
  EXPECT_EQ(image.notes, std::vector<std::string>{"COLORCORR \\x1b[2J\\xff was not divided out"});
  EXPECT_TRUE(says(error("#?RADIANCE\nFORMAT=\x1b[2J\n\n-Y 1 +X 1\n", ""), "format is \\x1b[2J;"));
}

TEST_F(RadianceReader, DeliversXyzAsItIs) {
  const Image image = good("#?RGBE\nFORMAT=32-bit_rle_xyze\n\n-Y 1 +X 1\n", bytes({128, 64, 32, 129}));
  const std::array<float, 8> xyz{1, 0, 0, 1, 0, 0, 1 / 3.0f, 1 / 3.0f};
  EXPECT_EQ(image.chromaticities, xyz);
  EXPECT_EQ(component(image, 0, 0, 1), 0.5f);
}

TEST_F(RadianceReader, RefusesWhatIsNotWhole) {
  const std::string size = header("", "-Y 2 +X 8");
  const std::string line = by_component(marked_line(8, 0));
  EXPECT_EQ(error(size, line + line), "read");
  for (size_t length = 0; length < 2 * line.size(); ++length) {
    EXPECT_TRUE(says(error(size, (line + line).substr(0, length)), "truncated"));
  }
}

TEST_F(RadianceReader, RefusesRunsThatDoNotFit) {
  const std::string size = header("", "-Y 1 +X 8"), start = bytes({2, 2, 0, 8});
  EXPECT_TRUE(says(error(size, start + bytes({128 + 9, 1})), "a run past the width in scan line 0"));
  EXPECT_TRUE(says(error(size, start + bytes({9, 1, 2, 3})), "a run past the width"));
  EXPECT_TRUE(says(error(size, start + bytes({0, 0, 0, 0})), "a literal of no length"));
  EXPECT_TRUE(says(error(size, bytes({2, 2, 0, 9, 1, 1})), "a length other than the header's"));
  EXPECT_TRUE(says(error(size, bytes({1, 1, 1, 8, 0, 0})), "a run without a pixel"));
  EXPECT_TRUE(says(error(size, bytes({9, 9, 9, 9, 1, 1, 1, 8})), "a run past the width"));
  // Runs without a length, each shifted further.
  std::string empty_runs = bytes({9, 9, 9, 9});
  for (int i = 0; i < 9; ++i) empty_runs += bytes({1, 1, 1, 0});
  EXPECT_TRUE(says(error(size, empty_runs), "a run past the width"));
}

TEST_F(RadianceReader, RefusesBrokenHeaders) {
  const std::string pixels(400, '\x09');
  EXPECT_TRUE(says(error("#?RADIANCE\n", ""), "does not end with an empty line"));
  EXPECT_TRUE(says(error("#?RADIANCE\nFORMAT=32-bit_rle_luv\n\n-Y 1 +X 1\n", pixels), "32-bit_rle_luv"));
  for (const char* size :
       {"", "64 48", "-Y 64", "-Y 1 +Y 1", "-Y a +X 1", "-Y 1 +X 1 +Z 1", "-Y 99999999999999999999 +X 1"}) {
    EXPECT_TRUE(says(error(header("", size), pixels), "has no image size")) << size;
  }
  for (const char* size : {"-Y -48 +X 64", "-Y 0 +X 1", "-Y 1 +X 0"}) {
    EXPECT_TRUE(says(error(header("", size), pixels), "at least 1x1")) << size;
  }
  EXPECT_TRUE(says(error("#?RADIANCE\n" + std::string(5000, 'x'), pixels), "does not end"));
  std::string lines;
  for (int i = 0; i < 2000; ++i) lines += "VIEW=x\n";
  EXPECT_TRUE(says(error("#?RADIANCE\n" + lines, pixels), "lines"));
}

TEST_F(RadianceReader, ChecksTheLimitsFromTheHeaderAlone) {
  for (const char* size :
       {"-Y 40000 +X 40000", "-Y 1 +X 16385", "-Y 16385 +X 1", "-Y 16384 +X 16384", "-Y 8000 +X 8000"}) {
    EXPECT_EQ(read(header("", size), "").status().code(), absl::StatusCode::kResourceExhausted) << size;
  }
  // Within the limits, but more pixels than 60 bytes can hold.
  EXPECT_TRUE(says(error(header("", "-Y 5000 +X 5000"), ""), "truncated"));
}

TEST_F(RadianceReader, SurvivesAnyDamage) {
  std::mt19937 random(2);
  std::string whole = header("EXPOSURE=2\n", "-Y 8 +X 40");
  for (int y = 0; y < 8; ++y) whole += by_component(marked_line(40, y));
  for (int i = 0; i < 2000; ++i) {
    std::string damaged = whole;
    for (int k = 0; k < 3; ++k) damaged[random() % damaged.size()] = static_cast<char>(random());
    write_file(path_, damaged);
    (void)read_image(path_, {.max_dimension = 1024});
  }
}

}  // namespace
}  // namespace candela
