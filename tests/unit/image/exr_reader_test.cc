// OpenEXR files through read_image(): values, windows, layers and metadata; refusals, gaps, and ZIP.
#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfMultiPartOutputFile.h>
#include <OpenEXR/ImfOutputFile.h>
#include <OpenEXR/ImfOutputPart.h>
#include <OpenEXR/ImfPartType.h>
#include <OpenEXR/ImfPreviewImage.h>
#include <OpenEXR/ImfRgbaFile.h>
#include <OpenEXR/ImfStandardAttributes.h>
#include <OpenEXR/ImfThreading.h>
#include <OpenEXR/ImfTileDescription.h>
#include <OpenEXR/ImfTiledOutputFile.h>
#include <gtest/gtest.h>
#include <hwy/highway.h>
#include <hwy/targets.h>
#include <zlib.h>

#include <cmath>
#include <cstring>
#include <random>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "tests/support/status.h"
#include "tests/unit/image/exr_reader_fixture.h"

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

// OpenEXR files that are refused: deep, without colour, beyond the limits, cut or damaged.

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

// OpenEXR files that are unfinished, cut off or damaged in places, and those that this OpenEXR does not know.

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

// ZIP and ZIPS scan lines, which candela decodes itself, against the same picture without compression, which
// OpenEXR decodes.

uint32_t noise(int x, int y, uint32_t seed) {
  std::minstd_rand random(static_cast<uint32_t>(x * 7919 + y * 104729) ^ (seed * 2654435761u));
  random.discard(2);
  return static_cast<uint32_t>(random()) << 1 ^ static_cast<uint32_t>(random());
}

ExrChannel smooth_channel(const std::string& name, Imf::PixelType type) {
  return {name, type, [](int x, int y) { return 1000 + x / 8 + y; }};
}

ExrChannel noisy_channel(const std::string& name, Imf::PixelType type) {
  const auto seed = static_cast<uint32_t>(name[0]);
  if (type == Imf::UINT) return {name, type, [seed](int x, int y) { return noise(x, y, seed); }};
  return {name, type, [seed](int x, int y) { return noise(x, y, seed) % 4096 * (1.0 / 1024) - 1; }};
}

class ExrZip : public ExrReader {
 protected:
  ~ExrZip() override { Imf::setGlobalThreadCount(0); }

  Image read_as(Imf::Compression compression, Imf::Header header, const std::vector<ExrChannel>& channels) {
    header.compression() = compression;
    write_scan_lines(path_, header, channels);
    return read();
  }

  static uint64_t entry(const std::string& bytes, size_t at) {
    uint64_t value = 0;
    std::memcpy(&value, bytes.data() + at, sizeof value);
    return value;
  }

  // Where the table of chunks is; the first chunk follows it.
  static size_t table_of(const std::string& bytes, size_t chunks) {
    size_t table = 0;
    while (entry(bytes, table) != table + 8 * chunks) ++table;
    return table;
  }

  // Whether both kinds are read as the picture without compression is.
  void expect_same(const Imf::Header& header, const std::vector<ExrChannel>& channels) {
    const Image expected = read_as(Imf::NO_COMPRESSION, header, channels);
    for (const Imf::Compression compression : {Imf::ZIP_COMPRESSION, Imf::ZIPS_COMPRESSION}) {
      const Image image = read_as(compression, header, channels);
      EXPECT_TRUE(same_pixels(image, expected))
          << expected.width << "x" << expected.height << ", " << channels.size() << " channels, compression "
          << compression;
      EXPECT_EQ(image.has_alpha, expected.has_alpha);
    }
  }
};

const std::vector<std::vector<ExrChannel>>& channel_lists() {
  static const auto* const kLists = new std::vector<std::vector<ExrChannel>>{
      rgb_channels(),
      rgb_channels(Imf::FLOAT),
      {noisy_channel("R", Imf::HALF), noisy_channel("G", Imf::HALF), noisy_channel("B", Imf::HALF),
       smooth_channel("A", Imf::HALF), noisy_channel("Z", Imf::FLOAT), noisy_channel("N.x", Imf::UINT)},
      {smooth_channel("R", Imf::HALF), noisy_channel("G", Imf::FLOAT), noisy_channel("B", Imf::UINT),
       smooth_channel("A", Imf::HALF), smooth_channel("id", Imf::UINT)},
      {noisy_channel("R", Imf::UINT), noisy_channel("G", Imf::UINT), noisy_channel("B", Imf::UINT)},
      {noisy_channel("Y", Imf::HALF), smooth_channel("A", Imf::HALF)},
      {smooth_channel("depth", Imf::FLOAT)},
      {smooth_channel("G", Imf::HALF), noisy_channel("B", Imf::HALF)},
  };
  return *kLists;
}

TEST_F(ExrZip, ReadsWhatOpenExrReads) {
  for (const int threads : {0, 3}) {
    Imf::setGlobalThreadCount(threads);
    for (const auto& channels : channel_lists()) {
      for (const auto& [width, height] : {std::pair{1, 1}, {1, 40}, {17, 33}, {331, 5}, {130, 50}}) {
        for (const Imf::LineOrder order : {Imf::INCREASING_Y, Imf::DECREASING_Y}) {
          Imf::Header header(width, height);
          header.lineOrder() = order;
          expect_same(header, channels);
        }
      }
    }
  }
}

TEST_F(ExrZip, ReadsAnyWindows) {
  const Box2i display(V2i(-3, 5), V2i(40, 64));
  for (const int threads : {0, 3}) {
    Imf::setGlobalThreadCount(threads);
    for (const Box2i& data : {display, Box2i(V2i(-20, -30), V2i(60, 300)), Box2i(V2i(0, 10), V2i(9, 50)),
                              Box2i(V2i(-1000, 7), V2i(-2, 23)), Box2i(V2i(30, 60), V2i(90, 90)),
                              Box2i(V2i(50, 70), V2i(60, 99))}) {
      for (const Imf::LineOrder order : {Imf::INCREASING_Y, Imf::DECREASING_Y}) {
        Imf::Header header(display, data);
        header.lineOrder() = order;
        expect_same(header, channel_lists()[2]);
        expect_same(header, channel_lists()[3]);
      }
    }
  }
}

TEST_F(ExrZip, EveryInstructionSetGivesTheSameBits) {
  for (int64_t rest = hwy::SupportedTargets() & HWY_TARGETS; rest != 0; rest &= rest - 1) {
    SCOPED_TRACE(hwy::TargetName(rest & -rest));
    hwy::SetSupportedTargetsForTest(rest & -rest);
    hwy::GetChosenTarget().Update(rest & -rest);
    for (const auto& channels : channel_lists()) expect_same(Imf::Header(131, 37), channels);
  }
  hwy::SetSupportedTargetsForTest(0);
  hwy::GetChosenTarget().Update(hwy::SupportedTargets());
}

// A file whose table of chunks is wrong was read before, because chunks that follow each other are found
// without it.
TEST_F(ExrZip, ADamagedTableOfChunksGivesTheSameForAnyThreads) {
  Imf::Header header(20, 100);
  const Image expected = read_as(Imf::ZIPS_COMPRESSION, header, rgb_channels());
  std::string bytes = read_file(path_);
  const size_t table = table_of(bytes, 100);
  for (size_t i = 1; i < 100; ++i) bytes[table + 8 * i] ^= 0x55;
  write_file(path_, bytes);
  for (const int threads : {0, 1, 3}) {
    Imf::setGlobalThreadCount(threads);
    for (int i = 0; i < 20; ++i) EXPECT_TRUE(same_pixels(read(), expected));
  }
}

TEST_F(ExrZip, AFlippedBitIsFound) {
  for (const int threads : {0, 3}) {
    Imf::setGlobalThreadCount(threads);
    const Image expected = read_as(Imf::ZIP_COMPRESSION, Imf::Header(60, 50), channel_lists()[2]);
    const std::string whole = read_file(path_);
    std::mt19937 random(1);
    int refused = 0;
    for (int i = 0; i < 200; ++i) {
      std::string damaged = whole;
      damaged[damaged.size() - 1 - random() % (damaged.size() / 2)] ^= static_cast<char>(1 << random() % 8);
      write_file(path_, damaged);
      const absl::StatusOr<Image> image = read_image(path_);
      EXPECT_TRUE(!image.ok() || same_pixels(*image, expected));  // some bits say nothing
      refused += image.ok() ? 0 : 1;
      EXPECT_EQ(error().find('\n'), std::string::npos);
    }
    EXPECT_GT(refused, 190);
  }
}

TEST_F(ExrZip, OnlyDamagedChunksAreLost) {
  read_as(Imf::ZIP_COMPRESSION, Imf::Header(20, 70), rgb_channels());
  std::string bytes = read_file(path_);
  const size_t second = entry(bytes, table_of(bytes, 5) + 8);
  for (const size_t at : {second, second + 8}) {  // its first row, and what it holds
    std::string damaged = bytes;
    damaged[at] ^= 0x55;
    write_file(path_, damaged);
    EXPECT_FALSE(read_image(path_).ok());
    ASSERT_OK_AND_ASSIGN(const Image image, read_image(path_, {}, {.fills_gaps = true}));
    EXPECT_EQ(image.missing_pixels, 20u * 16);
    EXPECT_EQ(component(image, 3, 31, 3), 0);
    EXPECT_EQ(component(image, 3, 32, 1), rgb_value(3, 32, 1));
  }
}

// Writes a stream of deflate, from the lowest bit of its first byte on.
class BitWriter {
 public:
  void bits(uint32_t value, int count) {
    for (int i = 0; i < count; ++i) bit(value >> i);
  }
  // Codes begin with their highest bit.
  void code(uint32_t value, int count) {
    for (int i = count - 1; i >= 0; --i) bit(value >> i);
  }
  const std::string& bytes() const { return bytes_; }

 private:
  void bit(uint32_t value) {
    if (count_ % 8 == 0) bytes_ += '\0';
    bytes_.back() = static_cast<char>(bytes_.back() | (value & 1) << count_ % 8);
    ++count_;
  }

  std::string bytes_;
  int count_ = 0;
};

// No compressor writes length codes 286 and 287. zlib refuses them, and libdeflate takes them for 285's 258.
// Then the checksum has to be right, which damage does not make it.
TEST_F(ExrZip, LengthsThatDeflateDoesNotHaveNeedTheRightChecksum) {
  read_as(Imf::ZIP_COMPRESSION, Imf::Header(20, 20), rgb_channels());
  const std::string bytes = read_file(path_);
  const std::string head = bytes.substr(0, bytes.rfind(std::string("\x10\0\0\0", 4)) + 4);
  const std::string raw(480, '\x80');  // the last chunk's
  const uint32_t checksum = adler32(1, reinterpret_cast<const Bytef*>(raw.data()), 480);
  for (const uint32_t length : {285, 286, 287}) {
    for (const uint32_t sum : {checksum, checksum ^ 1}) {
      BitWriter stream;
      stream.bits(0b01'1, 3);  // the last block, of fixed codes
      for (int i = 0; i < 222; ++i) stream.code(0x30 + 0x80, 8);
      stream.code(0xc0 + length - 280, 8);
      stream.code(0, 5);  // from the byte before
      stream.code(0, 7);  // the end
      std::string packed = "\x78\x01" + stream.bytes();
      for (int shift = 24; shift >= 0; shift -= 8) packed += static_cast<char>(sum >> shift);
      write_file(path_, head + static_cast<char>(packed.size()) + static_cast<char>(packed.size() >> 8) +
                            std::string(2, '\0') + packed);
      if (length == 285 || error() == "read") {
        EXPECT_EQ(error() == "read", sum == checksum) << length;
      } else {
        EXPECT_TRUE(says(error(), "rows 16 to 19 do not decompress to their pixels"));
      }
    }
  }
}

TEST_F(ExrZip, AChunkIsAsLongAsItsRows) {
  // The file's last chunk has 4 rows of 20 pixels with 6 bytes.
  read_as(Imf::ZIP_COMPRESSION, Imf::Header(20, 20), rgb_channels());
  std::string bytes = read_file(path_);
  const std::string start("\x10\0\0\0", 4);  // its first row
  const size_t chunk = bytes.rfind(start);
  for (const size_t size : {0, 1, 239, 479, 480, 481, 960, 1920}) {
    std::string packed(compressBound(size), '\0');
    uLongf length = packed.size();
    const std::string raw(size, '\x80');
    ASSERT_EQ(compress(reinterpret_cast<Bytef*>(packed.data()), &length,
                       reinterpret_cast<const Bytef*>(raw.data()), size),
              Z_OK);
    packed.resize(length);
    const std::string head = bytes.substr(0, chunk) + start;
    const auto little_endian = [](size_t n) {
      return std::string{static_cast<char>(n), static_cast<char>(n >> 8), 0, 0};
    };
    write_file(path_, head + little_endian(packed.size()) + packed);
    if (size == 480) {
      EXPECT_EQ(error(), "read");
    } else {
      EXPECT_TRUE(
          says(error(), "damaged OpenEXR file: rows 16 to 19 do not decompress to their pixels; 80 of"));
    }
    const absl::StatusOr<Image> filled = read_image(path_, {}, {.fills_gaps = true});
    ASSERT_OK(filled);
    EXPECT_EQ(filled->missing_pixels, size == 480 ? 0u : 80u) << size;
    // Bytes that are not compressed count as they are; too many have always been accepted.
    write_file(path_, head + little_endian(size) + raw);
    EXPECT_EQ(error() == "read", size >= 480) << size << ": " << error();
  }
}

}  // namespace
}  // namespace candela
