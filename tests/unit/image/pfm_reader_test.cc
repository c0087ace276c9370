#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>

#include "tests/support/files.h"
#include "tests/support/status.h"
#include "tests/unit/image/image_support.h"

namespace candela {
namespace {

std::string floats(std::initializer_list<float> values, bool swap = false) {
  std::string text;
  for (float v : values) {
    char bytes[4];
    std::memcpy(bytes, &v, 4);
    if (swap) std::reverse(bytes, bytes + 4);
    text.append(bytes, 4);
  }
  return text;
}

class PfmReader : public ::testing::Test {
 protected:
  TemporaryFolder folder_;
  const std::string path_ = folder_.path("in.pfm");

  absl::StatusOr<Image> read(const std::string& bytes) {
    write_file(path_, bytes);
    return read_image(path_);
  }
};

TEST_F(PfmReader, ReadsRowsFromTheBottomInEitherByteOrder) {
  for (const bool swap : {false, true}) {
    ASSERT_OK_AND_ASSIGN(const auto image, read((swap ? "PF\n1 2\n1.0\n" : "PF\n1 2\n-1.0\n") +
                                                floats({1, 2, 3, -4, 5e30f, 6}, swap)));
    EXPECT_EQ(image.format, ImageFormat::kRgba32f);
    EXPECT_TRUE(image.notes.empty());
    EXPECT_EQ(component(image, 0, 1, 0), 1);
    EXPECT_EQ(component(image, 0, 1, 2), 3);
    EXPECT_EQ(component(image, 0, 0, 0), -4);
    EXPECT_EQ(component(image, 0, 0, 1), 5e30f);
    EXPECT_EQ(component(image, 0, 0, 3), 1);
  }
}

TEST_F(PfmReader, SpreadsGreyAndMultipliesTheScaleIn) {
  ASSERT_OK_AND_ASSIGN(const auto image, read("Pf 2 1 -2.5\n" + floats({1, 4})));
  for (int c = 0; c < 3; ++c) EXPECT_EQ(component(image, 1, 0, c), 10);
  EXPECT_EQ(image.notes, std::vector<std::string>{"PFM scale 2.5 multiplied in"});
}

TEST_F(PfmReader, ReadsHeadersWithCommentsAndWithLineEndsInCrLf) {
  // Values whose first bytes look like the header's: CR, LF, space and #.
  for (const uint32_t bits : {0x3f80000du, 0x3f80000au, 0x3f800020u, 0x3f800023u}) {
    float first = 0;
    std::memcpy(&first, &bits, 4);
    for (const char* header :
         {"PF\n2 1\n-1\n", "PF\r\n2 1\r\n-1\r\n", "PF\r2 1\r-1\r", "PF 2 1 -1 ", "PF\n# a comment\n2 1\n-1\n",
          "PF\r\n# one\r\n# two\r\n2 # width\r\n1\r\n-1.0\r\n", "PF\n2 1\n#\n-1\n"}) {
      const auto image = read(header + floats({first, 2, 3, 4, 5, 6}));
      ASSERT_OK(image) << header;
      EXPECT_EQ(component(*image, 0, 0, 0), first) << header << std::hex << bits;
      EXPECT_EQ(component(*image, 1, 0, 2), 6) << header << std::hex << bits;
    }
  }
  ASSERT_OK_AND_ASSIGN(const auto image,
                       read("PF\n2 1\n-1.0 # little endian\n" + floats({1, 2, 3, 4, 5, 6})));
  EXPECT_EQ(component(image, 1, 0, 2), 6);
}

// https://github.com/Tom94/tev/pull/110
TEST_F(PfmReader, ReadsPf4WithAlpha) {
  ASSERT_OK_AND_ASSIGN(const auto image, read("PF4\n1 2\n-2.0\n" + floats({1, 2, 3, 0.5f, 5, 6, 7, 0.25f})));
  EXPECT_TRUE(image.has_alpha);
  EXPECT_EQ(component(image, 0, 1, 2), 6);
  EXPECT_EQ(component(image, 0, 1, 3), 0.5f) << "the scale is of light, not of alpha";
  EXPECT_EQ(component(image, 0, 0, 3), 0.25f);
}

TEST_F(PfmReader, FillsWhatAnUnfinishedFileLacks) {
  for (const std::string header : {"PF\n1 3\n-1\n", "PF\r\n1 3\r\n-1\r\n"}) {
    const std::string cut = header + floats({1, 2, 3, 4, 5, 6}) + "xx";
    EXPECT_TRUE(says(read(cut).status().message(), "--incomplete fill renders"));
    ASSERT_OK_AND_ASSIGN(const auto image, read_image(path_, {}, {.fills_gaps = true}));
    EXPECT_EQ(image.missing_pixels, 1u);
    EXPECT_EQ(component(image, 0, 0, 3), 0);
    EXPECT_EQ(component(image, 0, 1, 2), 6);
    EXPECT_EQ(component(image, 0, 2, 0), 1);
  }
}

TEST_F(PfmReader, RefusesWhatIsNotWholeOrHasNoSense) {
  const auto error = [&](const std::string& bytes) { return std::string(read(bytes).status().message()); };
  EXPECT_TRUE(says(error("PF\n2 2\n-1\n" + std::string(47, 'x')), "1 of 48 bytes"));
  EXPECT_TRUE(says(error("PF\n5000 5000\n-1\n"), "truncated"));
  for (const char* header : {"PF", "PF\n", "PF\n1 1\n", "PF\nx 1\n-1\n", "PFM\n1 1\n-1\n", "PF\n1 1\n-1"}) {
    EXPECT_TRUE(says(error(header), "PFM header")) << header;
  }
  for (const char* header :
       {"PF\n1 1\n0\n", "PF\n1 1\nnan\n", "PF\n1 1\ninf\n", "PF\n1 1\n1e60\n", "PF\n1 1\n-1e-60\n"}) {
    EXPECT_TRUE(says(error(header + std::string(12, 'x')), "scale")) << header;
  }
  // A vertical tab is white space in a number but not in the header.
  EXPECT_TRUE(says(error("PF\n1 1\n\v1e60\n"), "scale is \\x0b1e60; "));
  EXPECT_TRUE(says(error("PF\n-1 1\n-1\n"), "at least 1x1"));
  // 8 bytes per pixel would be within the limit, 16 are not.
  EXPECT_EQ(read("PF\n8000 8000\n-1\n").status().code(), absl::StatusCode::kResourceExhausted);
  EXPECT_EQ(read("PF\n40000 40000\n-1\n").status().code(), absl::StatusCode::kResourceExhausted);
  EXPECT_EQ(read("PF\n4294967297 4294967297\n-1\n").status().code(), absl::StatusCode::kResourceExhausted);
}

}  // namespace
}  // namespace candela
