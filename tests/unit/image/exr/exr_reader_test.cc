// Good OpenEXR files through read_image: values, windows, channels, layers, parts and metadata.
#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfMultiPartOutputFile.h>
#include <OpenEXR/ImfOutputFile.h>
#include <OpenEXR/ImfOutputPart.h>
#include <OpenEXR/ImfPartType.h>
#include <OpenEXR/ImfRgbaFile.h>
#include <OpenEXR/ImfStandardAttributes.h>
#include <OpenEXR/ImfTileDescription.h>
#include <gtest/gtest.h>

#include <cmath>

#include "tests/support/status.h"
#include "tests/unit/image/exr/exr_reader_fixture.h"

namespace candela {
namespace {

using Imath::Box2i;
using Imath::V2i;

TEST_F(ExrReader, TakesHalvesBitForBit) {
  // Every half, including NaNs with their payload, infinities and the negative zero.
  Imf::Header header(256, 256);
  write_scan_lines(path_, header, rgb_channels());
  std::vector<uint16_t> halves(65536);
  for (size_t i = 0; i < halves.size(); ++i) halves[i] = static_cast<uint16_t>(i);
  header.channels().insert("R", Imf::Channel(Imf::HALF));
  header.channels().insert("G", Imf::Channel(Imf::HALF));
  Imf::FrameBuffer frame;
  frame.insert("R", Imf::Slice::Make(Imf::HALF, halves.data(), header.dataWindow()));
  frame.insert("G", Imf::Slice::Make(Imf::HALF, halves.data(), header.dataWindow()));
  {
    Imf::OutputFile file(path_.c_str(), header);
    file.setFrameBuffer(frame);
    file.writePixels(256);
  }
  const Image image = read();
  ASSERT_EQ(image.format, ImageFormat::kRgba16f);
  const auto* pixels = reinterpret_cast<const uint16_t*>(image.pixels.data());
  for (size_t i = 0; i < halves.size(); ++i) {
    ASSERT_EQ(pixels[4 * i], i);
    ASSERT_EQ(pixels[4 * i + 1], i);
    ASSERT_EQ(pixels[4 * i + 2], 0);       // a missing channel
    ASSERT_EQ(pixels[4 * i + 3], 0x3c00);  // 1
  }
}

TEST_F(ExrReader, ReadsEveryCompression) {
  for (int c = 0; c < Imf::NUM_COMPRESSION_METHODS; ++c) {
    SCOPED_TRACE(c);
    Imf::Header header(67, 131);
    header.compression() = static_cast<Imf::Compression>(c);
    write_scan_lines(path_, header, rgb_channels());
    const bool lossy = c >= Imf::B44_COMPRESSION;
    expect_picture(read(), header.displayWindow(), header.dataWindow(), lossy ? 20 : 0);
  }
}

TEST_F(ExrReader, GivesFloatsForFloatsAndPlainNumbersForUnsignedIntegers) {
  const Imf::Header header(5, 3);
  write_scan_lines(path_, header, rgb_channels(Imf::FLOAT));
  Image image = read();
  EXPECT_EQ(image.format, ImageFormat::kRgba32f);
  expect_picture(image, header.displayWindow(), header.dataWindow());

  std::vector<ExrChannel> channels = rgb_channels();
  channels[1].type = Imf::UINT;
  channels[1].value = [](int x, int) { return x == 0 ? 16777215.0 : 70000.0; };
  write_scan_lines(path_, header, channels);
  image = read();
  EXPECT_EQ(image.format, ImageFormat::kRgba32f);
  EXPECT_EQ(component(image, 0, 0, 1), 16777215.0f);
  EXPECT_EQ(component(image, 1, 0, 1), 70000.0f);
}

TEST_F(ExrReader, TakesTheLargestLevelOfTiles) {
  for (const auto mode : {Imf::ONE_LEVEL, Imf::MIPMAP_LEVELS, Imf::RIPMAP_LEVELS}) {
    SCOPED_TRACE(mode);
    Imf::Header header(37, 53);
    write_tiles(path_, header, Imf::TileDescription(16, 8, mode), rgb_channels(), -7);
    expect_picture(read(), header.displayWindow(), header.dataWindow());
  }
}

TEST_F(ExrReader, RendersTheDisplayWindow) {
  const Box2i display(V2i(-3, 5), V2i(30, 24));
  const Box2i windows[] = {
      {V2i(-3, 5), V2i(30, 24)},      // the same
      {V2i(2, 9), V2i(11, 12)},       // inside
      {V2i(-20, -300), V2i(60, 90)},  // around
      {V2i(0, -10), V2i(10, 60)},     // across, up and down
      {V2i(-40, 7), V2i(40, 10)},     // across, left and right
      {V2i(25, 20), V2i(90, 700)},    // a corner, and more rows than a band
      {V2i(30, 24), V2i(35, 30)},     // one pixel
      {V2i(31, 5), V2i(40, 24)},      // beside
      {V2i(-3, -40), V2i(30, 4)},     // above
  };
  for (const Box2i& data : windows) {
    SCOPED_TRACE(::testing::Message() << data.min << " " << data.max);
    const Imf::Header header(display, data);
    for (const bool tiled : {false, true}) {
      if (tiled) {
        write_tiles(path_, header, Imf::TileDescription(9, 7), rgb_channels(), -7);
      } else {
        write_scan_lines(path_, header, rgb_channels());
      }
      const Image image = read();
      expect_picture(image, display, data);
      const bool covered = data.intersects(display.min) && data.intersects(display.max);
      EXPECT_EQ(image.has_alpha, !covered);
    }
  }
}

TEST_F(ExrReader, TurnsLinesOfDecreasingOrderUpright) {
  Imf::Header header(20, 40);
  header.lineOrder() = Imf::DECREASING_Y;
  write_scan_lines(path_, header, rgb_channels());
  expect_picture(read(), header.displayWindow(), header.dataWindow());
}

TEST_F(ExrReader, KeepsAlphaAsItIs) {
  std::vector<ExrChannel> channels = rgb_channels();
  channels.push_back({"A", Imf::HALF, [](int x, int) { return x * 0.25; }});
  write_scan_lines(path_, Imf::Header(7, 2), channels);
  const Image image = read();
  EXPECT_TRUE(image.has_alpha);
  for (uint32_t x = 0; x < 7; ++x) EXPECT_EQ(component(image, x, 1, 3), x * 0.25f);
}

TEST_F(ExrReader, TakesALoneChannelOfAnyNameAsGrey) {
  for (const char* name : {"Y", "G", "depth", "whitebarmask.mask"}) {
    for (const auto type : {Imf::HALF, Imf::FLOAT}) {
      SCOPED_TRACE(name);
      write_scan_lines(path_, Imf::Header(4, 3), {{name, type, [](int x, int y) { return x + 10 * y; }}});
      const Image image = read();
      EXPECT_FALSE(image.has_alpha);
      for (int c = 0; c < 3; ++c) EXPECT_EQ(component(image, 3, 2, c), 23);
      EXPECT_EQ(component(image, 3, 2, 3), 1);
    }
  }
}

TEST_F(ExrReader, ShowsALayerWhenThereAreNoPlainChannels) {
  std::vector<ExrChannel> channels = rgb_channels(Imf::HALF, "beauty.");
  channels.push_back({"Z", Imf::FLOAT, [](int, int) { return 3; }});
  channels.push_back({"a.normal.X", Imf::FLOAT, [](int, int) { return 4; }});
  channels.push_back({"a.normal.Y", Imf::FLOAT, [](int, int) { return 5; }});
  const Imf::Header header(6, 6);
  write_scan_lines(path_, header, channels);
  const Image image = read();
  EXPECT_EQ(image.format, ImageFormat::kRgba16f);
  expect_picture(image, header.displayWindow(), header.dataWindow());
  EXPECT_EQ(image.notes, std::vector<std::string>{"layer beauty is shown; there is also --layer Z"});
}

TEST_F(ExrReader, ShowsTheFirstPartWithColour) {
  std::vector<Imf::Header> headers(3, Imf::Header(12, 9));
  const std::vector<ExrChannel> depth{{"Z", Imf::FLOAT, [](int, int) { return 5; }}};
  std::vector<ExrChannel> other = rgb_channels();
  for (ExrChannel& channel : other) channel.value = [](int, int) { return -1; };
  const ExrPixels pixels[] = {{headers[0], depth}, {headers[1], rgb_channels()}, {headers[2], other}};
  const char* const names[] = {"depth", "beauty", "other"};
  for (int i = 0; i < 3; ++i) {
    headers[i].setName(names[i]);
    headers[i].setType(Imf::SCANLINEIMAGE);
  }
  {
    Imf::MultiPartOutputFile file(path_.c_str(), headers.data(), 3);
    for (int i = 0; i < 3; ++i) {
      Imf::OutputPart part(file, i);
      part.setFrameBuffer(pixels[i].frame());
      part.writePixels(9);
    }
  }
  const Image image = read();
  expect_picture(image, headers[1].displayWindow(), headers[1].dataWindow());
  EXPECT_EQ(image.notes, std::vector<std::string>{
                             "part 2 of 3, beauty, is shown; there are also --part depth, --part other"});
}

TEST_F(ExrReader, DecodesLuminanceAndChromaInAnyWindow) {
  // Smooth, because the chroma is stored at half the size.
  const auto value = [](int x, int y, int c) {
    return 1.0f + 0.01f * x + 0.005f * static_cast<float>(y * (c + 1));
  };
  const Box2i display(V2i(0, 0), V2i(39, 29));
  for (const Box2i& data : {display, Box2i(V2i(4, 6), V2i(21, 15)), Box2i(V2i(-10, -20), V2i(61, 41))}) {
    SCOPED_TRACE(::testing::Message() << data.min << " " << data.max);
    const int width = data.max.x - data.min.x + 1, height = data.max.y - data.min.y + 1;
    std::vector<Imf::Rgba> pixels(static_cast<size_t>(width) * height);
    for (int y = 0; y < height; ++y) {
      for (int x = 0; x < width; ++x) {
        const int px = x + data.min.x, py = y + data.min.y;
        pixels[x + static_cast<size_t>(y) * width] =
            Imf::Rgba(value(px, py, 0), value(px, py, 1), value(px, py, 2), 1.0f);
      }
    }
    {
      Imf::RgbaOutputFile file(path_.c_str(), Imf::Header(display, data), Imf::WRITE_YC);
      file.setYCRounding(10, 10);
      file.setFrameBuffer(pixels.data() - data.min.x - std::ptrdiff_t{data.min.y} * width, 1, width);
      file.writePixels(height);
    }
    const Image image = read();
    EXPECT_EQ(image.format, ImageFormat::kRgba16f);
    for (int y = 0; y < 30; ++y) {
      for (int x = 0; x < 40; ++x) {
        for (int c = 0; c < 3; ++c) {
          const float expected = data.intersects(V2i(x, y)) ? value(x, y, c) : 0;
          ASSERT_NEAR(component(image, x, y, c), expected, 0.03) << x << ", " << y;
        }
      }
    }
  }
}

TEST_F(ExrReader, HonoursChromaticities) {
  Imf::Header header(2, 2);
  write_scan_lines(path_, header, rgb_channels());
  EXPECT_FALSE(read().chromaticities.has_value());

  Imf::addChromaticities(header, Imf::Chromaticities());  // Rec.709 in words
  write_scan_lines(path_, header, rgb_channels());
  EXPECT_FALSE(read().chromaticities.has_value());

  Imf::addChromaticities(header, Imf::Chromaticities({0.7347f, 0.2653f}, {0, 1}, {0.0001f, -0.077f},
                                                     {0.32168f, 0.33767f}));  // ACES2065-1
  write_scan_lines(path_, header, rgb_channels());
  const std::array<float, 8> aces{0.7347f, 0.2653f, 0, 1, 0.0001f, -0.077f, 0.32168f, 0.33767f};
  EXPECT_EQ(read().chromaticities, aces);
}

TEST_F(ExrReader, IgnoresSingularChromaticitiesAndSaysSo) {
  const float nan = std::nanf("");
  const Imf::Chromaticities singular[] = {
      {{0, 0}, {0, 0}, {0, 0}, {0, 0}},
      {{0.1f, 0.1f}, {0.2f, 0.2f}, {0.3f, 0.3f}, {0.3127f, 0.329f}},  // on a line
      {{0.64f, 0.33f}, {0.3f, 0.6f}, {0.15f, 0.06f}, {0.3f, 0}},      // white without luminance
      {{0.64f, nan}, {0.3f, 0.6f}, {0.15f, 0.06f}, {0.3127f, 0.329f}},
      {{0.64f, 0.33f}, {0.3f, INFINITY}, {0.15f, 0.06f}, {0.3127f, 0.329f}},
  };
  for (const Imf::Chromaticities& chromaticities : singular) {
    Imf::Header header(2, 2);
    Imf::addChromaticities(header, chromaticities);
    write_scan_lines(path_, header, rgb_channels());
    const Image image = read();
    EXPECT_FALSE(image.chromaticities.has_value());
    ASSERT_EQ(image.notes.size(), 1u);
    EXPECT_TRUE(says(image.notes[0], "singular"));
  }
}

TEST_F(ExrReader, CarriesThePixelAspect) {
  write_scan_lines(path_, Imf::Header(2, 2, 1.5f), rgb_channels());
  EXPECT_EQ(read().pixel_aspect, 1.5);
  write_scan_lines(path_, Imf::Header(2, 2, 5000.0f), rgb_channels());
  const Image image = read();
  EXPECT_EQ(image.pixel_aspect, 1.0);
  EXPECT_EQ(image.notes.size(), 1u);
}

}  // namespace
}  // namespace candela
