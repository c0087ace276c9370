// OpenEXR files that are refused: deep, without colour, beyond the limits, cut or damaged.
#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfMultiPartOutputFile.h>
#include <OpenEXR/ImfOutputPart.h>
#include <OpenEXR/ImfPartType.h>
#include <OpenEXR/ImfPreviewImage.h>
#include <OpenEXR/ImfRgbaFile.h>
#include <OpenEXR/ImfStandardAttributes.h>
#include <OpenEXR/ImfTileDescription.h>
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "tests/support/status.h"
#include "tests/unit/image/exr/exr_reader_fixture.h"

namespace candela {
namespace {

using Imath::Box2i;
using Imath::V2i;

TEST_F(ExrReader, RefusesDeepImagesByName) {
  write_deep(path_);
  EXPECT_TRUE(says(error(), "deep image"));
}

TEST_F(ExrReader, NamesTheChannelsOfAnImageWithoutColour) {
  write_scan_lines(path_, Imf::Header(2, 2),
                   {{"forward.u", Imf::HALF, [](int, int) { return 0; }},
                    {"forward.v", Imf::HALF, [](int, int) { return 0; }}});
  EXPECT_EQ(read_image(path_).status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_TRUE(says(error(), "no colour channels (it has forward.u, forward.v)"));
}

TEST_F(ExrReader, RefusesLuminanceWithoutWeights) {
  Imf::Header header(4, 4);
  Imf::addChromaticities(header, Imf::Chromaticities());
  const std::vector<Imf::Rgba> pixels(16, Imf::Rgba(1, 1, 1));
  {
    Imf::RgbaOutputFile file(path_.c_str(), header, Imf::WRITE_YC);
    file.setFrameBuffer(pixels.data(), 1, 4);
    file.writePixels(4);
  }
  ASSERT_OK(read_image(path_));

  std::string bytes = read_file(path_);
  const std::string name("chromaticities\0chromaticities\0\x20\0\0\0", 34);
  const size_t at = bytes.find(name);
  ASSERT_NE(at, std::string::npos);
  bytes.replace(at + name.size() + 7 * sizeof(float), sizeof(float), sizeof(float), '\0');
  write_file(path_, bytes);
  EXPECT_TRUE(says(error(), "white.y cannot be zero"));
}

TEST_F(ExrReader, NamesOfAFileCannotBreakALineOrCommandATerminal) {
  // A layer that is shown, and a layer with a subsampled red channel.
  write_scan_lines(path_, Imf::Header(2, 2), rgb_channels(Imf::HALF, "a\n\x1b[2J\xff."));
  EXPECT_EQ(read().notes, std::vector<std::string>{"layer a\\x0a\\x1b[2J\\xff is shown"});

  std::string bytes = read_file(path_);
  const std::string red("[2J\xff.R\0\1\0\0\0\0\0\0\0\1", 16);
  const size_t at = bytes.find(red);
  ASSERT_NE(at, std::string::npos);
  bytes[at + red.size() - 1] = 2;
  write_file(path_, bytes);
  EXPECT_TRUE(says(error(), "channel a\\x0a\\x1b[2J\\xff.R is subsampled 2x1"));

  Imf::Header depth(2, 2), colour(2, 2);
  const ExrPixels no_colour(
      depth, {{"X", Imf::HALF, [](int, int) { return 1; }}, {"Z", Imf::HALF, [](int, int) { return 1; }}});
  const ExrPixels pixels(colour, rgb_channels());
  std::vector<Imf::Header> headers{depth, colour};
  headers[0].setName("depth");
  headers[1].setName("\x1b[2J");
  for (Imf::Header& header : headers) header.setType(Imf::SCANLINEIMAGE);
  {
    Imf::MultiPartOutputFile file(path_.c_str(), headers.data(), 2);
    for (int i = 0; i < 2; ++i) {
      Imf::OutputPart part(file, i);
      part.setFrameBuffer(i == 0 ? no_colour.frame() : pixels.frame());
      part.writePixels(2);
    }
  }
  EXPECT_EQ(read().notes, std::vector<std::string>{"part 2 of 2, \\x1b[2J, is shown"});
}

TEST_F(ExrReader, ChecksTheLimitsFromTheHeaderAlone) {
  const auto refuses = [&](const Box2i& display, const Box2i& data, Imf::PixelType type = Imf::HALF) {
    write_scan_lines(path_, Imf::Header(display, data), rgb_channels(type));
    const absl::Status status = read_image(path_, {.max_dimension = 64, .max_bytes = 2048 * 8}).status();
    return status.code() == absl::StatusCode::kResourceExhausted;
  };
  const Box2i small(V2i(0, 0), V2i(3, 3));
  EXPECT_FALSE(refuses({V2i(0, 0), V2i(63, 31)}, small));
  EXPECT_FALSE(refuses({V2i(0, 0), V2i(31, 31)}, small, Imf::FLOAT));
  EXPECT_TRUE(refuses({V2i(0, 0), V2i(31, 32)}, small, Imf::FLOAT));
  EXPECT_TRUE(refuses({V2i(0, 0), V2i(64, 0)}, small));
  EXPECT_TRUE(refuses({V2i(0, 0), V2i(0, 64)}, small));
  EXPECT_TRUE(refuses({V2i(0, 0), V2i(63, 32)}, small));
  EXPECT_TRUE(refuses(small, {V2i(0, 0), V2i(64, 0)}));
  EXPECT_TRUE(refuses(small, {V2i(-30, -30), V2i(30, 30)}));
  EXPECT_TRUE(refuses({V2i(-1000000000, 0), V2i(1000000000, 0)}, small));

  write_tiles(path_, Imf::Header(8, 8), Imf::TileDescription(8192, 8192), rgb_channels(), 0);
  EXPECT_TRUE(says(error(), "smaller tiles"));
}

TEST_F(ExrReader, HoldsItsMemoryAgainstTheChunksOfTheCompression) {
  auto channels = rgb_channels();
  for (int i = 0; i < 37; ++i) {
    channels.push_back({"more." + std::to_string(i), Imf::FLOAT, [](int x, int y) { return x + y; }});
  }
  for (const Imf::Compression compression :
       {Imf::ZIP_COMPRESSION, Imf::PIZ_COMPRESSION, Imf::DWAB_COMPRESSION}) {
    Imf::Header header(64, 300);
    header.compression() = compression;
    write_scan_lines(path_, header, channels);
    const absl::Status status = read_image(path_, {.max_chunk_bytes = 1 << 20}).status();
    EXPECT_EQ(status.ok(), compression != Imf::DWAB_COMPRESSION) << status;
  }
}

TEST_F(ExrReader, RefusesAFileCutAnywhere) {
  for (const bool tiled : {false, true}) {
    const Imf::Header header(40, 40);
    if (tiled) {
      write_tiles(path_, header, Imf::TileDescription(16, 16), rgb_channels(), 0);
    } else {
      write_scan_lines(path_, header, rgb_channels());
    }
    const std::string bytes = read_file(path_);
    for (size_t length = 0; length < bytes.size(); length += 1 + length / 20) {
      write_file(path_, bytes.substr(0, length));
      EXPECT_EQ(error().find("INVALID_ARGUMENT: " + path_), 0u) << length << ": " << error();
    }
    write_file(path_, bytes.substr(0, bytes.size() - 1));
    EXPECT_EQ(error().find("INVALID_ARGUMENT: " + path_), 0u) << error();
  }
}

TEST_F(ExrReader, TakesNoMemoryForAttributesThatAreNotThere) {
  Imf::Header header(4, 4);
  Imf::addComments(header, "fifteen letters");
  Imf::addMultiView(header, {"left", "right"});
  header.setPreviewImage(Imf::PreviewImage(2, 3));
  write_scan_lines(path_, header, rgb_channels());
  const std::string whole = read_file(path_);
  expect_picture(read(), header.displayWindow(), header.dataWindow());

  // Sets byte `at` after the text `after`, which ends with an attribute's type, to 0x5b. As the highest byte
  // of a size, that means 1.5 GB.
  const auto refused = [&](const std::string& after, size_t at) {
    std::string bytes = whole;
    bytes[bytes.find(after) + after.size() + at] = 0x5b;
    write_file(path_, bytes);
    return error();
  };
  using namespace std::string_literals;
  EXPECT_TRUE(says(refused("comments\0string\0"s, 3), "attribute comments claims 1526726671 bytes"));
  EXPECT_TRUE(says(refused("preview\0preview\0"s, 4 + 1), "attribute preview does not have the 32 bytes"));
  EXPECT_TRUE(says(refused("multiView\0stringvector\0"s, 4 + 3), "attribute multiView does not have"));
  EXPECT_TRUE(says(refused("dataWindow\0box2i\0"s, 0), "attribute dataWindow does not have the 91 bytes"));
  EXPECT_TRUE(says(refused("channels\0chlist\0"s, 0), "attribute channels does not have the 91 bytes"));
}

TEST_F(ExrReader, SurvivesAnyDamage) {
  std::mt19937 random(1);
  for (const auto compression :
       {Imf::NO_COMPRESSION, Imf::ZIP_COMPRESSION, Imf::PIZ_COMPRESSION, Imf::DWAA_COMPRESSION}) {
    Imf::Header header(40, 40);
    header.compression() = compression;
    write_scan_lines(path_, header, rgb_channels());
    const std::string bytes = read_file(path_);
    for (int i = 0; i < 150; ++i) {
      std::string damaged = bytes;
      const size_t within = i % 2 == 0 ? 400 : damaged.size();  // half of them in the header
      for (int k = 0; k < 3; ++k) damaged[random() % within] = static_cast<char>(random());
      write_file(path_, damaged);
      const std::string text = error({.max_dimension = 4096});
      EXPECT_EQ(text.find('\n'), std::string::npos) << text;
    }
  }
}

}  // namespace
}  // namespace candela
