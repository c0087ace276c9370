// OpenEXR files that are unfinished, cut off or damaged in places, and those that this OpenEXR does not know.
#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfMultiPartOutputFile.h>
#include <OpenEXR/ImfOutputFile.h>
#include <OpenEXR/ImfOutputPart.h>
#include <OpenEXR/ImfPartType.h>
#include <OpenEXR/ImfTileDescription.h>
#include <OpenEXR/ImfTiledOutputFile.h>
#include <gtest/gtest.h>

#include "absl/strings/str_format.h"
#include "tests/support/status.h"
#include "tests/unit/image/exr/exr_reader_fixture.h"

namespace candela {
namespace {

using Imath::Box2i;
using Imath::V2i;

class ExrGaps : public ExrReader {
 protected:
  // Writes the first `rows` rows of a picture, as a renderer that was killed leaves it.
  void write_rows(Imf::Header header, int rows, const std::vector<ExrChannel>& channels = rgb_channels()) {
    const ExrPixels pixels(header, channels);
    Imf::OutputFile file(path_.c_str(), header);
    file.setFrameBuffer(pixels.frame());
    file.writePixels(rows);
  }

  // Expects the picture where `there` says so, and nothing with alpha 0 elsewhere.
  template <typename There>
  void expect_there(const Image& image, There there) {
    uint64_t missing = 0;
    for (uint32_t y = 0; y < image.height; ++y) {
      for (uint32_t x = 0; x < image.width; ++x) {
        const bool is_there = there(static_cast<int>(x), static_cast<int>(y));
        missing += is_there ? 0 : 1;
        for (int c = 0; c < 4; ++c) {
          const double expected = !is_there ? 0
                                  : c == 3  ? 1
                                            : rgb_value(static_cast<int>(x), static_cast<int>(y), c);
          ASSERT_EQ(component(image, x, y, c), expected) << x << "," << y << " component " << c;
        }
      }
    }
    EXPECT_EQ(image.missing_pixels, missing);
    EXPECT_TRUE(image.has_alpha);
  }

  Image filled() {
    absl::StatusOr<Image> image = read_image(path_, {}, {.fills_gaps = true});
    EXPECT_OK(image);
    return image.ok() ? *std::move(image) : Image{};
  }
};

TEST_F(ExrGaps, AnUnfinishedFileIsNoDamagedOne) {
  for (const Imf::Compression compression : {Imf::NO_COMPRESSION, Imf::ZIPS_COMPRESSION, Imf::ZIP_COMPRESSION,
                                             Imf::PIZ_COMPRESSION, Imf::DWAA_COMPRESSION}) {
    Imf::Header header(20, 70);
    header.compression() = compression;
    write_rows(header, 64);
    EXPECT_FALSE(says(error(), "damaged"));
    EXPECT_TRUE(says(error(),
                     "the file is unfinished or cut off: 120 of its 1400 pixels are missing; --incomplete "
                     "fill renders what is there"));
    const Image image = filled();
    EXPECT_EQ(image.missing_pixels, 120u);
    EXPECT_EQ(component(image, 3, 69, 3), 0);
    EXPECT_EQ(component(image, 3, 63, 3), 1);
    if (compression != Imf::DWAA_COMPRESSION) expect_there(image, [](int, int y) { return y < 64; });
    ASSERT_EQ(image.notes.size(), 1u);
  }
}

TEST_F(ExrGaps, ACutFileIsReadUpToItsEnd) {
  write_scan_lines(path_, Imf::Header(20, 70), rgb_channels());
  const std::string whole = read_file(path_);
  write_file(path_, whole.substr(0, whole.size() - 200));  // in the last chunk but one
  EXPECT_TRUE(says(error(), "unfinished or cut off"));
  const Image image = filled();
  expect_there(image, [&](int, int y) { return y < 48; });
  // Nothing is there, or not even the header.
  write_file(path_, whole.substr(0, 500));
  EXPECT_FALSE(read_image(path_, {}, {.fills_gaps = true}).ok());
  write_file(path_, whole.substr(0, 100));
  EXPECT_FALSE(read_image(path_, {}, {.fills_gaps = true}).ok());
}

TEST_F(ExrGaps, TilesAreMissingByThemselves) {
  for (const Imf::LevelMode mode : {Imf::ONE_LEVEL, Imf::MIPMAP_LEVELS}) {
    Imf::Header header(50, 40);
    header.setTileDescription(Imf::TileDescription(16, 16, mode));
    header.lineOrder() = Imf::RANDOM_Y;  // else OpenEXR keeps tiles back until the one before is there
    const ExrPixels pixels(header, rgb_channels());
    {
      Imf::TiledOutputFile file(path_.c_str(), header);
      file.setFrameBuffer(pixels.frame());
      for (int y = 0; y < 3; ++y) {
        for (int x = 0; x < 4; ++x) {
          if ((x != 1 || y != 1) && (x != 3 || y != 2)) file.writeTile(x, y);
        }
      }
    }
    EXPECT_TRUE(says(error(), "unfinished"));
    expect_there(filled(),
                 [](int x, int y) { return (x / 16 != 1 || y / 16 != 1) && (x / 16 != 3 || y / 16 != 2); });
  }
}

TEST_F(ExrGaps, OtherPartsDoNotMatter) {
  for (const int rows : {4, 8}) {
    std::vector<Imf::Header> headers(2, Imf::Header(6, 8));
    const ExrPixels pixels[] = {{headers[0], rgb_channels()}, {headers[1], rgb_channels()}};
    for (int i = 0; i < 2; ++i) {
      headers[i].setName(i == 0 ? "rgba" : "albedo");
      headers[i].setType(Imf::SCANLINEIMAGE);
      headers[i].compression() = Imf::ZIPS_COMPRESSION;
    }
    {
      Imf::MultiPartOutputFile file(path_.c_str(), headers.data(), 2);
      for (int i = 0; i < 2; ++i) {
        Imf::OutputPart part(file, i);
        part.setFrameBuffer(pixels[i].frame());
        part.writePixels(i == 0 ? rows : 3);
      }
    }
    EXPECT_EQ(read_image(path_).ok(), rows == 8) << error();
    if (rows == 4) expect_there(filled(), [](int, int y) { return y < 4; });
    ASSERT_OK_AND_ASSIGN(const Image second, read_image(path_, {}, {.part = "2", .fills_gaps = true}));
    EXPECT_EQ(second.missing_pixels, 30u);
  }
}

TEST_F(ExrGaps, OnlyWhatThePictureShowsIsCounted) {
  Imf::Header header(Box2i(V2i(0, 0), V2i(9, 9)), Box2i(V2i(-5, -5), V2i(12, 20)));
  header.compression() = Imf::NO_COMPRESSION;
  write_rows(header, 10);  // to y = 4
  const Image image = filled();
  expect_there(image, [](int, int y) { return y <= 4; });
  write_rows(header, 15);  // all of the picture; OpenEXR need not read more
  EXPECT_OK(read_image(path_)) << error();
}

TEST_F(ExrGaps, ADamagedChunkIsCountedToo) {
  Imf::Header header(40, 64);
  header.compression() = Imf::ZIP_COMPRESSION;
  write_scan_lines(path_, header, rgb_channels());
  std::string bytes = read_file(path_);
  for (size_t i = bytes.size() - 40; i < bytes.size(); ++i) bytes[i] = static_cast<char>(~bytes[i]);
  write_file(path_, bytes);
  EXPECT_TRUE(says(error(), "damaged OpenEXR file"));
  EXPECT_TRUE(says(error(), "640 of its 2560 pixels are missing; --incomplete fill"));
  expect_there(filled(), [](int, int y) { return y < 48; });
}

TEST_F(ExrGaps, AWholeFileIsTheSameWithTheOption) {
  write_scan_lines(path_, Imf::Header(20, 70), rgb_channels());
  const Image image = filled();
  EXPECT_TRUE(same_pixels(image, read()));
  EXPECT_EQ(image.missing_pixels, 0u);
  EXPECT_TRUE(image.notes.empty());
}

TEST_F(ExrGaps, NamesACompressionAndAVersionThatAreUnknown) {
  write_scan_lines(path_, Imf::Header(4, 4), rgb_channels());
  const std::string whole = read_file(path_);
  const std::string name("compression\0compression\0\1\0\0\0", 28);
  const size_t at = whole.find(name);
  ASSERT_NE(at, std::string::npos);
  const auto with = [&](size_t where, int value) {
    std::string bytes = whole;
    bytes[where] = static_cast<char>(value);
    write_file(path_, bytes);
    EXPECT_EQ(read_image(path_).status().code(), absl::StatusCode::kUnimplemented) << error();
    EXPECT_FALSE(says(error(), "damaged"));
    return error();
  };
  EXPECT_TRUE(says(with(at + name.size(), 10), "HTJ2K256, which OpenEXR 3.4"));
  EXPECT_TRUE(says(with(at + name.size(), 11), "HTJ2K32, which OpenEXR 3.4"));
  EXPECT_TRUE(says(with(at + name.size(), 77), "number 77, which a later OpenEXR"));
  EXPECT_TRUE(says(with(4, 3), "version 3 of OpenEXR's format"));
  EXPECT_TRUE(says(with(5, 0x40), "flags 0x4000"));
}

}  // namespace
}  // namespace candela
