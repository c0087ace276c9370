// `candela contact`: pictures, names, frame numbers and exposures on one sheet.
#include <gtest/gtest.h>

#include <filesystem>
#include <set>
#include <string>
#include <vector>

#include "tests/cli/command.h"
#include "tests/cli/stream_fixture.h"
#include "tests/support/files.h"
#include "tests/support/status.h"
#include "tests/unit/image/png.h"

namespace candela {
namespace {

constexpr int kSheetGrey = 32;  // behind the pictures
constexpr uint32_t kSheetGap = 12, kSheetCellWidth = 320, kSheetWordsHeight = 40;

// The part of a rectangle that is not the sheet's grey.
double drawn(const Png& sheet, uint32_t x, uint32_t y, uint32_t width, uint32_t height) {
  uint32_t other = 0;
  for (uint32_t i = 0; i < width * height; ++i) {
    other += sheet.code(x + i % width, y + i / width, 0) != kSheetGrey ? 1 : 0;
  }
  return other / static_cast<double>(width * height);
}

class Contact : public StreamFixture {
 protected:
  std::string sheet() const { return folder_.path("sheets/sheet.png"); }
};

TEST_F(Contact, ASheetHasEachPictureWithItsWords) {
  make_frames(5);
  ASSERT_EQ(candela({"sample", in() + "/large.exr", "--size", "640x360", "-q"}).code, 0);
  const Outcome outcome = candela({"contact", in(), sheet()});
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_TRUE(says(outcome.out, "6 of 6 images -> " + sheet()));
  const Png png = read_png(sheet());
  // Three columns, two rows of the large picture's 320x180.
  EXPECT_EQ(png.width, kSheetGap + 3 * (kSheetCellWidth + kSheetGap));
  EXPECT_EQ(png.height, kSheetGap + 2 * (180 + kSheetWordsHeight + kSheetGap));
  for (uint32_t i = 0; i < 6; ++i) {
    SCOPED_TRACE(i);
    const uint32_t x = kSheetGap + i % 3 * (kSheetCellWidth + kSheetGap);
    const uint32_t words = kSheetGap + 180 + i / 3 * (180 + kSheetWordsHeight + kSheetGap);
    for (const uint32_t line : {4, 22}) {
      EXPECT_GT(drawn(png, x, words + line, kSheetCellWidth, 14), .02);
    }
    EXPECT_EQ(drawn(png, x, words + kSheetWordsHeight, kSheetCellWidth, kSheetGap), 0);
    if (i == 5) {  // large.exr, as wide as its cell
      EXPECT_GT(drawn(png, x, words - 180, kSheetCellWidth, 180), .9);
      continue;
    }
    // A picture that is smaller than a cell has its own pixels.
    const std::string alone = folder_.path("alone.png");
    ASSERT_EQ(candela({"render", in() + "/000" + std::to_string(i) + ".exr", alone, "-q"}).code, 0);
    const Png frame = read_png(alone);
    for (uint32_t at = 0; at < 64 * 48 * 3; ++at) {
      ASSERT_EQ(png.code(x + (kSheetCellWidth - 64) / 2 + at / 3 % 64, words - 48 + at / 192, at % 3),
                frame.code(at / 3 % 64, at / 192, at % 3));
    }
  }
}

TEST_F(Contact, ABrokenImageIsNamedAndTheOthersAreThere) {
  make_frames(3);
  write_file(in() + "/0001.exr", "no picture");
  const Outcome outcome = candela({"contact", in(), sheet(), "-q", "--json", "-", "--columns", "3"});
  EXPECT_EQ(outcome.code, 3);
  EXPECT_TRUE(says(outcome.err, "0001.exr"));
  EXPECT_TRUE(says(outcome.err, "1 of 3 images failed"));
  EXPECT_EQ(lines_of(outcome.out).size(), 4u);
  const Png png = read_png(sheet());
  const uint32_t cell = png.width / 3;
  EXPECT_EQ(drawn(png, cell + kSheetGap, kSheetGap, cell - 2 * kSheetGap, 48), 0);
  EXPECT_GT(drawn(png, cell + kSheetGap, kSheetGap + 48 + 22, cell - 2 * kSheetGap, 14), .02);
  // Without any picture there is no sheet.
  std::filesystem::remove(sheet());
  EXPECT_EQ(candela({"contact", in() + "/0001.exr", sheet(), "-q"}).code, 3);
  EXPECT_FALSE(std::filesystem::exists(sheet()));
}

// The letters are ASCII, so others are their numbers.
TEST_F(Contact, NamesOfEveryScriptCanBeToldApart) {
  make_frames(2);
  std::set<std::string> sheets;
  const std::vector<std::string> names = {"\u753b\u50cf", "\u5199\u771f", "e",     "\u00e9", "e\u0301",
                                          "\U0001f600",   "\xff",         "<E9>.", "<FF>"};
  for (const std::string& name : names) {
    const std::string file = folder_.path(name + ".exr");
    std::filesystem::copy_file(in() + "/0000.exr", file);
    ASSERT_EQ(candela({"contact", file, sheet(), "-q"}).code, 0) << name;
    sheets.insert(read_file(sheet()));
  }
  EXPECT_EQ(sheets.size(), names.size());
}

TEST_F(Contact, WhatCannotBeIsSaid) {
  make_frames(2);
  EXPECT_TRUE(says(candela({"contact", in(), folder_.path("o.exr")}).err, "o.exr holds light; a sheet is a"));
  EXPECT_TRUE(says(candela({"contact", in(), folder_.path("o.avif")}).err,
                   "o.avif holds more than 8 bits; a sheet is a .png, .jpg or .tif"));
  EXPECT_TRUE(says(candela({"contact", in()}).err, "contact needs images and a sheet"));
  EXPECT_TRUE(says(candela({"contact", in(), sheet(), "--columns", "0"}).err, "--columns"));
  const std::string file = in() + "/0000.exr";
  std::filesystem::create_symlink(file, folder_.path("link.png"));
  EXPECT_TRUE(says(candela({"contact", file, folder_.path("link.png")}).err, "is the input"));
}

}  // namespace
}  // namespace candela
