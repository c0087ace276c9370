// Images through pipes: taken one after the other, y4m, and frames written.
#include <OpenEXR/ImfMultiPartOutputFile.h>
#include <OpenEXR/ImfOutputPart.h>
#include <OpenEXR/ImfPartType.h>
#include <gtest/gtest.h>
#include <half.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstring>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "client/base/failure.h"
#include "client/image/color.h"
#include "client/image/read/image_stream.h"
#include "client/image/read/y4m_frames.h"
#include "client/image/write/piped_frames.h"
#include "tests/support/files.h"
#include "tests/support/status.h"
#include "tests/unit/image/image_support.h"
#include "tests/unit/image/png.h"

namespace candela {
namespace {

struct Pipe {
  Pipe() { EXPECT_EQ(pipe(ends), 0); }
  int ends[2] = {};
};

// A pipe that these bytes come through.
class Fed {
 public:
  explicit Fed(const std::string& bytes)
      : writer_([this, bytes] {
          for (size_t at = 0; at < bytes.size();) {
            const ssize_t count =
                write(pipe_.ends[1], bytes.data() + at, std::min<size_t>(bytes.size() - at, 777));
            if (count <= 0) break;
            at += static_cast<size_t>(count);
          }
          close(pipe_.ends[1]);
        }) {}
  ~Fed() {
    close(pipe_.ends[0]);
    writer_.join();
  }
  int descriptor() const { return pipe_.ends[0]; }

 private:
  const Pipe pipe_;
  std::thread writer_;
};

std::string phm(const std::string& head, std::initializer_list<float> values, bool swap = false) {
  std::string text = head;
  for (const float value : values) {
    const uint16_t bits = half(value).bits();
    text.push_back(static_cast<char>(swap ? bits >> 8 : bits));
    text.push_back(static_cast<char>(swap ? bits : bits >> 8));
  }
  return text;
}

std::string pfm(const std::string& head, const std::vector<float>& values) {
  std::string text = head;
  text.append(reinterpret_cast<const char*>(values.data()), 4 * values.size());
  return text;
}

class ImageStreams : public ::testing::Test {
 protected:
  ImageStreams() { std::signal(SIGPIPE, SIG_IGN); }

  // All images of the stream, or the first failure.
  absl::StatusOr<std::vector<Image>> read(const std::string& bytes, const ImageLimits& limits = {},
                                          const PictureChoice& choice = {}) {
    const Fed fed(bytes);
    ImageStream stream(fed.descriptor(), "pipe", limits, choice);
    std::vector<Image> images;
    while (std::optional<absl::StatusOr<Image>> image = stream.next()) {
      if (!image->ok()) return image->status();
      images.push_back(*std::move(*image));
    }
    EXPECT_OK(stream.lost());
    return images;
  }
  std::string failure(const std::string& bytes, const ImageLimits& limits = {}) {
    return std::string(read(bytes, limits).status().message());
  }
  std::string exr(const std::string& name) const { return read_file(folder_.path(name)); }

  const TemporaryFolder folder_;
};

TEST_F(ImageStreams, FilesOneAfterAnotherAreThoseFiles) {
  std::vector<std::string> names;
  const auto name = [&] { return folder_.path(names.emplace_back(std::to_string(names.size()) + ".exr")); };
  for (int c = 0; c < Imf::NUM_COMPRESSION_METHODS; ++c) {
    Imf::Header header(45, 67);
    header.compression() = static_cast<Imf::Compression>(c);
    write_scan_lines(name(), header, rgb_channels());
    write_tiles(name(), header, Imf::TileDescription(16, 24), rgb_channels(), 0);
  }
  for (const auto mode : {Imf::MIPMAP_LEVELS, Imf::RIPMAP_LEVELS}) {
    for (const auto round : {Imf::ROUND_DOWN, Imf::ROUND_UP}) {
      write_tiles(name(), Imf::Header(45, 19), Imf::TileDescription(8, 4, mode, round), rgb_channels(), 0);
    }
  }
  Imf::Header upwards(Imath::Box2i({-3, 5}, {12, 64}), Imath::Box2i({-20, -30}, {20, 30}));
  upwards.lineOrder() = Imf::DECREASING_Y;
  write_scan_lines(name(), upwards, rgb_channels());
  std::string all;
  for (const std::string& file : names) all += exr(file);
  names.push_back("last.pfm");
  write_file(folder_.path("last.pfm"), pfm("PF\n2 1\n-1\n", {1, 2, 3, 4, 5, 6}));
  all += exr("last.pfm");
  ASSERT_OK_AND_ASSIGN(const std::vector<Image> images, read(all));
  ASSERT_EQ(images.size(), names.size());
  for (size_t i = 0; i < names.size(); ++i) {
    ASSERT_OK_AND_ASSIGN(const Image file, read_image(folder_.path(names[i])));
    EXPECT_TRUE(same_pixels(images[i], file)) << i;
  }
}

TEST_F(ImageStreams, APhmComesFromTheTopAndAPfmFromBelow) {
  const std::string halves = phm("PH\n1 2\n-1.000000\n", {1, 2, 3, 4, 5, 6}),
                    big = phm("PH\n1 2\n1.000000\n", {1, 2, 3, 4, 5, 6}, true),
                    grey = phm("Ph\n2 1\n-1.000000\n", {7, 8}), doubled = phm("PH\n1 1\n-2\n", {1, 2, 3}),
                    floats = pfm("PF\n1 2\n-1\n", {1, 2, 3, 4, 5, 6});
  ASSERT_OK_AND_ASSIGN(const std::vector<Image> images, read(halves + big + grey + doubled + floats));
  ASSERT_EQ(images.size(), 5u);
  for (int i = 0; i < 2; ++i) {
    EXPECT_EQ(images[i].format, ImageFormat::kRgba16f);
    EXPECT_EQ(component(images[i], 0, 0, 0), 1);
    EXPECT_EQ(component(images[i], 0, 1, 2), 6);
    EXPECT_EQ(component(images[i], 0, 1, 3), 1);
  }
  EXPECT_EQ(component(images[2], 1, 0, 1), 8);
  EXPECT_EQ(images[3].format, ImageFormat::kRgba32f);
  EXPECT_EQ(component(images[3], 0, 0, 2), 6);
  EXPECT_EQ(component(images[4], 0, 0, 0), 4);
  ASSERT_OK_AND_ASSIGN(const std::vector<Image> top, read(floats, {}, {.rows = RowOrder::kTop}));
  EXPECT_EQ(component(top[0], 0, 0, 0), 1);
  ASSERT_OK_AND_ASSIGN(const std::vector<Image> low, read(halves, {}, {.rows = RowOrder::kBottom}));
  EXPECT_EQ(component(low[0], 0, 0, 0), 4);
  write_file(folder_.path("a.phm"), halves);
  ASSERT_OK_AND_ASSIGN(const Image file, read_image(folder_.path("a.phm")));
  EXPECT_TRUE(same_pixels(file, images[0]));
}

TEST_F(ImageStreams, PixelsThatLookLikeAHeaderAreNone) {
  std::string all;
  for (const char* head :
       {"PF\n1 1\n-1\n", "PF\r\n1 1\r\n-1\r\n", "PF 1 1 -1 ", "PF\n# a comment\n1 1\n-1\n"}) {
    for (const char* first : {"\n", "\r", " ", "#"}) {
      all += head + std::string(first) + std::string("\0\0\x3f", 3) + pfm("", {2, 3});
    }
  }
  ASSERT_OK_AND_ASSIGN(const std::vector<Image> images, read(all));
  EXPECT_EQ(images.size(), 16u);
  for (const Image& image : images) EXPECT_EQ(component(image, 0, 0, 2), 3);
}

TEST_F(ImageStreams, ABrokenFrameIsNamedByItsNumber) {
  const std::string good = pfm("PF\n1 1\n-1\n", {1, 2, 3});
  EXPECT_EQ(failure(good + good + "what?"),
            "pipe, frame 3: here no PFM, PHM, PNG, OpenEXR or y4m begins, so what follows cannot be read");
  EXPECT_EQ(failure(good + good.substr(0, good.size() - 1)),
            "pipe, frame 2: the file is truncated: 1 of 12 bytes of pixels is missing");
  EXPECT_EQ(failure("PF"),
            "pipe, frame 1: its PFM header is not 'PF', 'PF4' or 'Pf', width, height and "
            "scale, each followed by white space");
  EXPECT_EQ(failure("P"), "pipe, frame 1: not an OpenEXR, Radiance, PFM, PNG, AVIF, JPEG or TIFF file");
  EXPECT_TRUE(failure(good + "PF\n#" + std::string(9999, ' ')).starts_with("pipe, frame 2: its PFM header"));
  EXPECT_TRUE(
      failure("#?RADIANCE\n").starts_with("pipe, frame 1: a Radiance file does not say where it ends"));
  write_scan_lines(folder_.path("a.exr"), Imf::Header(20, 40), rgb_channels());
  write_deep(folder_.path("deep.exr"));
  const std::string file = exr("a.exr");
  EXPECT_TRUE(failure(good + exr("deep.exr")).starts_with("pipe, frame 2: an OpenEXR file of several parts"));
  for (const size_t cut : {size_t{1}, file.size() / 2, file.size() - 9, file.size() - 400}) {
    EXPECT_TRUE(failure(good + file.substr(0, file.size() - cut)).starts_with("pipe, frame 2: ")) << cut;
  }
}

TEST_F(ImageStreams, LimitsHoldBeforeMemoryIsTaken) {
  EXPECT_TRUE(
      failure("PF\n99999 1\n-1\n").starts_with("pipe, frame 1: the image is 99999x1 pixels; the limit"));
  EXPECT_TRUE(failure("PF\n9000 9000\n-1\n").find("the limit is 536870912 bytes") != std::string::npos);
  write_scan_lines(folder_.path("a.exr"), Imf::Header(20, 40), rgb_channels());
  std::string file = exr("a.exr");
  EXPECT_TRUE(failure(file, {.max_chunk_bytes = 100}).find("--max-chunk-mib allows 100") !=
              std::string::npos);
  EXPECT_TRUE(failure(file, {.max_bytes = 6400, .max_pixels = 799}).find("--max-pixels allows 799") !=
              std::string::npos);
  // An attribute that claims a gigabyte.
  const size_t at = file.find("compression") + 24;
  const uint32_t claimed = 1u << 30;
  std::memcpy(file.data() + at, &claimed, 4);
  EXPECT_TRUE(failure(file).starts_with("pipe, frame 1: damaged OpenEXR file: attribute compression claims"));
}

TEST_F(ImageStreams, PngsComeOneAfterAnother) {
  const std::string grey = png_of(3, 8, 0, "abc"), wide = png_of(1, 16, 2, "abcdef", cicp(9, 16));
  const std::string frame = pfm("PF\n1 1\n-1\n", {1, 2, 3});
  ASSERT_OK_AND_ASSIGN(const std::vector<Image> images, read(grey + wide + frame + grey));
  ASSERT_EQ(images.size(), 4u);
  const std::string* const files[] = {&grey, &wide, &frame, &grey};
  for (size_t i = 0; i < images.size(); ++i) {
    ASSERT_OK_AND_ASSIGN(const Image file, read_image_bytes("file", *files[i]));
    EXPECT_TRUE(same_pixels(images[i], file)) << i;
    EXPECT_EQ(images[i].light == PictureLight::kHdr, i == 1);
  }
  // Wherever the stream ends, it is that frame which is cut. All its pixels are before IEND.
  for (size_t size = 1; size < grey.size() - 16; ++size) {
    EXPECT_TRUE(failure(wide + grey.substr(0, size)).starts_with("pipe, frame 2: ")) << size;
  }
  EXPECT_EQ(failure(grey + "\x89PNG\r\n\x1a\r" + grey),
            "pipe, frame 2: damaged PNG file: its first 8 bytes are not those of a PNG");
  EXPECT_EQ(failure(grey.substr(0, 8) + chunk("IDAT", "") + grey),
            "pipe, frame 1: damaged PNG file: it begins without IHDR");
  // Limits hold before memory is taken.
  const auto sized = [&](uint32_t width, uint32_t height) {
    return grey.substr(0, 8) +
           chunk("IHDR", big_endian(width) + big_endian(height) + std::string("\x8\0\0\0\0", 5));
  };
  EXPECT_TRUE(failure(sized(0, 1)).find("it must be at least 1x1") != std::string::npos);
  EXPECT_TRUE(failure(sized(0xffffffff, 1)).find("4294967295x1 pixels; the limit is") != std::string::npos);
  EXPECT_TRUE(failure(sized(9000, 9000)).find("the limit is 536870912 bytes") != std::string::npos);
  EXPECT_TRUE(failure(sized(1, 1) + big_endian(0xffffffff) + "IDAT")
                  .find("it takes more than the 2147483648 bytes") != std::string::npos);
  // A damaged frame whose end is known does not end the stream.
  std::string damaged = grey;
  damaged[damaged.find("IDAT") + 6] ^= 1;
  const Fed fed(grey + damaged + grey);
  ImageStream stream(fed.descriptor(), "pipe", {}, {});
  EXPECT_OK(stream.next()->status());
  EXPECT_TRUE(says(stream.next()->status().message(), "pipe, frame 2: damaged PNG file: "));
  EXPECT_OK(stream.next()->status());
  EXPECT_FALSE(stream.next().has_value());
}

TEST_F(ImageStreams, RealFilesAreTheSameThroughAPipe) {
  if (data_folder().empty()) GTEST_SKIP() << "there is no test data";
  size_t streamed = 0;
  for (const char* folder : {"exr", "compression", "display_window", "radiance", "sequence", "bad"}) {
    for (const std::string& name : data_files(folder)) {
      const std::string bytes = read_file(name);
      const absl::StatusOr<Image> file = read_image(name);
      {
        const Fed fed(bytes);
        const absl::StatusOr<Image> piped = read_piped_image(fed.descriptor(), "pipe", {}, {});
        ASSERT_EQ(piped.ok(), file.ok()) << name << piped.status() << file.status();
        if (file.ok()) {
          EXPECT_TRUE(same_pixels(*piped, *file)) << name;
        }
      }
      const Fed fed(bytes + bytes);
      ImageStream stream(fed.descriptor(), "pipe", {}, {});
      for (int i = 0; i < 2; ++i) {
        const std::optional<absl::StatusOr<Image>> image = stream.next();
        if (absl::IsUnimplemented(stream.lost())) break;  // several parts, or Radiance
        ASSERT_TRUE(image.has_value()) << name;
        if (file.ok()) {
          ASSERT_OK(image->status()) << name;
        }
        if (!image->ok()) break;
        if (file.ok()) {
          EXPECT_TRUE(same_pixels(**image, *file)) << name;
        }
        ++streamed;
      }
    }
  }
  EXPECT_GT(streamed, 60u);
}

TEST_F(ImageStreams, AnEmptyStreamIsNoImage) {
  const Fed none("");
  EXPECT_EQ(read_piped_image(none.descriptor(), "pipe", {}, {}).status().message(),
            "pipe: the file is empty");
}

TEST_F(ImageStreams, AStreamThatIsStoppedWhileItWaitsEnds) {
  const Pipe pipe;
  ImageStream stream(pipe.ends[0], "pipe", {}, {});
  std::thread stops([&stream] {
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
    stream.stop();
  });
  EXPECT_FALSE(stream.next().has_value());
  stops.join();
  close(pipe.ends[0]);
  close(pipe.ends[1]);
}

constexpr PictureChoice kSignals{.transfer = SignalTransfer::kLinear};

std::string bytes_of(const std::vector<int>& codes, int bits) {
  std::string bytes;
  for (const int code : codes) {
    bytes.push_back(static_cast<char>(code));
    if (bits > 8) bytes.push_back(static_cast<char>(code >> 8));
  }
  return bytes;
}

absl::StatusOr<Image> frame_of(const std::string& words, const std::string& planes,
                               const PictureChoice& choice = kSignals, const ImageLimits& limits = {}) {
  const absl::StatusOr<Y4mFrames> frames = Y4mFrames::of("y4m", "YUV4MPEG2 " + words, limits, choice);
  if (!frames.ok()) return frames.status();
  EXPECT_EQ(frames->frame_bytes(), planes.size());
  return frames->image(std::as_bytes(std::span(planes)));
}

// All images of a pipe, or the first failure.
absl::StatusOr<std::vector<Image>> piped(const std::string& bytes, const PictureChoice& choice = kSignals) {
  int ends[2];
  EXPECT_EQ(pipe(ends), 0);
  std::thread writer([&bytes, to = ends[1]] {
    EXPECT_EQ(write(to, bytes.data(), bytes.size()), static_cast<ssize_t>(bytes.size()));
    close(to);
  });
  ImageStream stream(ends[0], "pipe", {}, choice);
  std::vector<Image> images;
  absl::Status status;
  while (std::optional<absl::StatusOr<Image>> image = stream.next()) {
    status.Update(image->status());
    if (image->ok()) images.push_back(**std::move(image));
  }
  writer.join();
  close(ends[0]);
  if (!status.ok()) return status;
  return images;
}

// Colours that change slowly, as 16-bit codes.
Image slow_colours(uint32_t width, uint32_t height) {
  Image picture = *make_image(width, height, ImageFormat::kRgba16);
  for (uint32_t y = 0; y < height; ++y) {
    for (uint32_t x = 0; x < width; ++x) {
      const double across = 0.5 + 0.4 * std::sin(0.05 * x), down = 0.5 + 0.4 * std::cos(0.07 * y);
      const uint16_t pixel[4] = {static_cast<uint16_t>(65535 * across), static_cast<uint16_t>(65535 * down),
                                 static_cast<uint16_t>(65535 * across * down), 65535};
      std::memcpy(picture.pixels.data() + y * picture.row_bytes() + 8 * x, pixel, sizeof pixel);
    }
  }
  return picture;
}

TEST(Y4mFrames, WhatCandelaWritesComesBack) {
  for (const PipeKind kind : {PipeKind::kY4m420, PipeKind::kY4m444}) {
    for (const int bits : {8, 10}) {
      for (const bool rec2020 : {false, true}) {
        for (const auto& [width, height] : {std::pair(64, 48), {31, 17}, {1, 1}, {2, 1}, {1, 2}, {3, 3}}) {
          const Image picture = slow_colours(static_cast<uint32_t>(width), static_cast<uint32_t>(height));
          PipeFormat format{kind, bits};
          if (rec2020) format.matrix = kRec2020Luma;
          std::vector<std::byte> frame;
          make_piped_frame(format, picture, frame);
          std::string all = film_header(format, picture.width, picture.height, 1.5, {24000, 1001});
          for (int i = 0; i < 2; ++i) all.append(reinterpret_cast<const char*>(frame.data()), frame.size());
          PictureChoice choice = kSignals;
          choice.own_values = rec2020;
          if (rec2020) choice.primaries = {0.708f, 0.292f, 0.170f, 0.797f, 0.131f, 0.046f, 0.3127f, 0.3290f};
          ASSERT_OK_AND_ASSIGN(const std::vector<Image> images, piped(all, choice));
          ASSERT_EQ(images.size(), 2u);
          EXPECT_EQ(images[1].pixel_aspect, 1.5);
          EXPECT_EQ(images[1].frame_rate, (FrameRate{24000, 1001}));
          EXPECT_EQ(images[1].signal, absl::StrCat(bits, " bits, linear, assumed"));
          EXPECT_FALSE(images[1].has_alpha);
          double most = 0;
          for (uint32_t y = 0; y < picture.height; ++y) {
            for (uint32_t x = 0; x < picture.width; ++x) {
              for (int c = 0; c < 3; ++c) {
                most = std::max(
                    most, std::fabs(component(images[1], x, y, c) - component(picture, x, y, c) / 65535.0));
              }
            }
          }
          // Half a code of luma and of chroma; and with 4:2:0 what their curve bends within two pixels.
          const double code = 0.5 / 219 + 2 * 0.94 * 0.5 / 224;
          EXPECT_LE(most, (bits == 8 ? code : code / 4) + (kind == PipeKind::kY4m420 ? 0.02 : 1e-4))
              << bits << " " << width << "x" << height << " " << images[1].signal;
        }
      }
    }
  }
}

// By hand, from ITU-R BT.709: red is 63, 102, 240 of limited range and 54, 99, 255 of full range.
TEST(Y4mFrames, CodesAreTheStandards) {
  const struct {
    const char* words;
    int bits;
    std::vector<int> codes;
    double rgb[3];
  } cases[] = {{"C444", 8, {16, 128, 128}, {0, 0, 0}},
               {"C444", 8, {235, 128, 128}, {1, 1, 1}},
               {"C444", 8, {63, 102, 240}, {1, 0, 0}},
               {"C444 XCOLORRANGE=FULL", 8, {54, 99, 255}, {1, 0, 0}},
               {"C444 XCOLORRANGE=FULL", 8, {255, 128, 128}, {1, 1, 1}},
               {"C444p10", 10, {940, 512, 512}, {1, 1, 1}},
               {"C444p10", 10, {65535, 512, 512}, {1, 1, 1}},  // beyond ten bits
               {"C444 XCOLORRANGE=LIMITED", 8, {0, 128, 128}, {0, 0, 0}},
               {"C422", 8, {235, 128, 128}, {1, 1, 1}},
               {"C422p10", 10, {502, 512, 512}, {.5, .5, .5}},
               {"Cmono", 8, {235}, {1, 1, 1}},
               {"Cmono10", 10, {502}, {.5, .5, .5}},
               {"", 8, {126, 128, 128}, {.5023, .5023, .5023}}};
  for (const auto& one : cases) {
    ASSERT_OK_AND_ASSIGN(const Image image, frame_of(absl::StrCat("W1 H1 F25:1 Ip A1:1 ", one.words),
                                                     bytes_of(one.codes, one.bits),
                                                     {.transfer = SignalTransfer::kLinear, .matrix = 1}));
    for (int c = 0; c < 3; ++c) EXPECT_NEAR(component(image, 0, 0, c), one.rgb[c], 4e-3) << one.words << c;
  }
}

// Cr of 32 more than grey: R - Y is 1.402, 1.5748 or 1.4746 of it.
TEST(Y4mFrames, TheMatrixIsThatOfTheSizeOrTheUsers) {
  const auto red = [](uint32_t height, const PictureChoice& choice, bool noted) {
    const std::string planes =
        std::string(height, '\x7e') + std::string(height, '\x80') + std::string(height, '\xa0');
    const absl::StatusOr<Image> image = frame_of(absl::StrCat("W1 H", height, " C444"), planes, choice);
    EXPECT_OK(image.status());
    const bool says_so = std::ranges::any_of(image->notes, [](const std::string& note) {
      return says(note, "y4m does not name its matrix: taken as BT.601, as of fewer than 720 lines");
    });
    EXPECT_EQ(says_so, noted) << height;
    return (component(*image, 0, 0, 0) - 110 / 219.0) * 224 / 32;
  };
  EXPECT_NEAR(red(719, kSignals, true), 1.402, 1e-3);
  EXPECT_NEAR(red(720, kSignals, false), 1.5748, 1e-3);
  constexpr std::array<float, 8> kRec2020{0.708f, 0.292f, 0.170f, 0.797f, 0.131f, 0.046f, 0.3127f, 0.3290f};
  EXPECT_NEAR(red(1, {.transfer = SignalTransfer::kLinear, .primaries = kRec2020}, false), 1.4746, 1e-3);
  for (const auto& [code, scale] : {std::pair(1, 1.5748), {4, 1.4}, {6, 1.402}, {7, 1.576}, {9, 1.4746}}) {
    EXPECT_NEAR(red(1, {.transfer = SignalTransfer::kLinear, .matrix = code}, false), scale, 1e-3);
  }
  EXPECT_REFUSED(kInvalidArgument, "y4m: --input-matrix names matrix 8 of H.273, which a y4m does not have",
                 frame_of("W1 H1 C444", "abc", {.matrix = 8}));
  const std::string white = bytes_of({255, 128, 128}, 8);
  ASSERT_OK_AND_ASSIGN(const Image full, frame_of("W1 H1 C444", white, {.full_range = true}));
  EXPECT_EQ(component(full, 0, 0, 0), 1);
  const std::string limited = bytes_of({16, 128, 128}, 8);
  ASSERT_OK_AND_ASSIGN(const Image black,
                       frame_of("W1 H1 C444 XCOLORRANGE=FULL", limited, {.full_range = false}));
  EXPECT_EQ(component(black, 0, 0, 0), 0);
}

// A ramp of chroma is a ramp, from where its samples are: beside the even pixels, or between two of a pair.
TEST(Y4mFrames, ChromaIsWhereItsWordSays) {
  const auto red = [](const char* word, uint32_t x, uint32_t y) {
    std::vector<int> codes(48, 126);
    for (int row = 0; row < 2; ++row) {
      for (int i = 0; i < 6; ++i) codes.push_back(128);
    }
    for (int row = 0; row < 2; ++row) {
      for (int i = 0; i < 6; ++i) codes.push_back(100 + 8 * i + 20 * row);
    }
    codes.resize(48 + 24);
    const absl::StatusOr<Image> image = frame_of(absl::StrCat("W12 H4 ", word), bytes_of(codes, 8));
    EXPECT_OK(image);
    return (component(*image, x, y, 0) - 110 / 219.0) * 224 / (2 * (1 - .299)) + 128;
  };
  // Sample 1 of the first row is 108.
  EXPECT_NEAR(red("C420mpeg2", 2, 0), 108, 0.01);
  EXPECT_NEAR(red("C420mpeg2", 3, 0), 112, 0.01);
  EXPECT_NEAR(red("C420jpeg", 2, 0), 106, 0.01);
  EXPECT_NEAR(red("C420jpeg", 3, 0), 110, 0.01);
  EXPECT_NEAR(red("C420jpeg", 0, 0), 100, 0.01);
  EXPECT_NEAR(red("C420mpeg2", 2, 1), 113, 0.01);  // a quarter of the way down
  EXPECT_NEAR(red("C420mpeg2", 2, 3), 128, 0.01);
}

TEST(Y4mFrames, TheTransferIsTheUsers) {
  const std::string white = bytes_of({235, 128, 128}, 8);
  ASSERT_OK_AND_ASSIGN(const Image srgb, frame_of("W1 H1 C444", bytes_of({126, 128, 128}, 8), {}));
  EXPECT_NEAR(component(srgb, 0, 0, 0), std::pow((110 / 219.0 + .055) / 1.055, 2.4), 1e-4);
  EXPECT_TRUE(says(srgb.notes.front(), "y4m does not name its transfer: taken as sRGB"));
  ASSERT_OK_AND_ASSIGN(const Image pq, frame_of("W1 H1 C444", white, {.transfer = SignalTransfer::kPq}));
  EXPECT_NEAR(component(pq, 0, 0, 0), 10000 / 203.0, 1e-4);
  EXPECT_EQ(pq.light, PictureLight::kHdr);
  EXPECT_EQ((*pq.chromaticities)[0], 0.708f);
}

TEST(Y4mFrames, WhatCannotBeReadIsNamed) {
  const auto refused = [](const std::string& bytes, const std::string& words) {
    const absl::Status status = piped(bytes).status();
    EXPECT_TRUE(says(status.message(), words)) << status;
  };
  const std::string head = "YUV4MPEG2 W2 H1 F25:1 C444\n", frame = "FRAME\n" + std::string(6, '\x80');
  EXPECT_OK(piped(head + frame + frame + head + frame));
  EXPECT_OK(piped(head + "FRAME Ip\n" + std::string(6, '\x80')));
  refused(head, "pipe, frame 1: the y4m ends before its first frame");
  refused(head + frame + frame.substr(0, 9),
          "pipe, frame 2: the file is truncated: 3 of 6 bytes of the frame are missing");
  refused(head + frame + "FRAM", "pipe, frame 2: a line of the y4m does not end within 4096 bytes");
  refused(head + frame + "FRAMES\n", "pipe, frame 2: a y4m's frame begins with FRAME, and here is FRAMES");
  refused(head + frame + "junk", "pipe, frame 2: here no PFM, PHM, PNG, OpenEXR or y4m begins");
  refused("FRAME\nabc", "pipe, frame 1: here no PFM");
  refused("YUV4MPEG2 " + std::string(9999, 'x'), "pipe, frame 1: a line of the y4m does not end within");
  refused("YUV4MPEG3 W2 H1\nFRAME\n", "pipe, frame 1: its y4m header does not begin with YUV4MPEG2");
  refused("YUV4MPEG2 H1\nFRAME\n", "pipe, frame 1: the image is 0x1 pixels; it must be at least 1x1");
  refused("YUV4MPEG2 W2x H1\nFRAME\n", "its y4m header says W2x, which is no size");
  refused("YUV4MPEG2 W-5 H1\nFRAME\n", "the image is -5x1 pixels");
  refused("YUV4MPEG2 W99999999999999999999 H1\nFRAME\n", "which is no size");
  refused("YUV4MPEG2 W90000 H1\nFRAME\n", "90000x1 pixels; the limit is");
  refused("YUV4MPEG2 W9000 H9000\nFRAME\n", "the limit is 536870912 bytes");
  refused("YUV4MPEG2 W2 H1 C411\nFRAME\n", "its y4m planes are 411; Candela reads 420jpeg, 420mpeg2, 422");
  refused("YUV4MPEG2 W2 H1 C420p12\nFRAME\n", "its y4m planes are 420p12");
  ASSERT_OK_AND_ASSIGN(const Image strange, frame_of("W2 H1 F0:0 It A0:0 C444", std::string(6, '\x80')));
  EXPECT_FALSE(strange.frame_rate);
  EXPECT_EQ(strange.pixel_aspect, 1);
  EXPECT_EQ(strange.notes.front(), "the y4m is interlaced: its frames are shown as they are");
}

// A picture, and the signals in 0 .. 1 that its codes of 16 bits were rounded from.
struct Signals {
  Image picture;
  std::vector<double> rgb;
};

// Random colours, with the corners of the cube and greys among them.
Signals random_signals(uint32_t width, uint32_t height) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> any(0, 1);
  Signals made;
  made.picture = *make_image(width, height, ImageFormat::kRgba16);
  for (uint32_t i = 0; i < width * height; ++i) {
    const double grey = any(random);
    uint16_t codes[4] = {0, 0, 0, 65535};
    for (int c = 0; c < 3; ++c) {
      const double value = i % 7 == 0 ? (i >> c & 1) : i % 7 == 1 ? grey : any(random);
      made.rgb.push_back(value);
      codes[c] = static_cast<uint16_t>(std::lround(value * 65535));
    }
    std::memcpy(made.picture.pixels.data() + 8 * size_t{i}, codes, sizeof codes);
  }
  return made;
}

// The planes of BT.601, BT.709 or BT.2020 in float64, from the unrounded signals: luma, Cb, Cr.
std::vector<double> twin(const Signals& from, const PipeFormat& format) {
  const int width = static_cast<int>(from.picture.width), height = static_cast<int>(from.picture.height);
  const double scale = std::exp2(format.bits - 8);
  const int matrix = format.matrix ? format.matrix->code : height < 720 ? 6 : 1;
  const double kr = matrix == 9 ? .2627 : matrix == 1 ? .2126 : .299;
  const double kb = matrix == 9 ? .0593 : matrix == 1 ? .0722 : .114;
  const auto signal = [&](int x, int y, int c) {
    const int i = std::min(y, height - 1) * width + std::clamp(x, 0, width - 1);
    return from.rgb[static_cast<size_t>(3 * i + c)];
  };
  const auto luma = [&](const double* rgb) { return kr * rgb[0] + (1 - kr - kb) * rgb[1] + kb * rgb[2]; };
  std::vector<double> planes;
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const double rgb[3] = {signal(x, y, 0), signal(x, y, 1), signal(x, y, 2)};
      planes.push_back(scale * (16 + 219 * luma(rgb)));
    }
  }
  const bool halved = format.kind == PipeKind::kY4m420;
  const int step = halved ? 2 : 1;
  for (const int component : {2, 0}) {
    const double range = component == 2 ? 2 * (1 - kb) : 2 * (1 - kr);
    for (int y = 0; y < height; y += step) {
      for (int x = 0; x < width; x += step) {
        double rgb[3];
        for (int c = 0; c < 3; ++c) {
          rgb[c] = signal(x, y, c);
          if (!halved) continue;
          rgb[c] = 0;
          for (int down = 0; down < 2; ++down) {
            for (int along = -1; along < 2; ++along) {
              rgb[c] += (along == 0 ? .25 : .125) * signal(x + along, y + down, c);
            }
          }
        }
        planes.push_back(scale * (128 + 224 * (rgb[component] - luma(rgb)) / range));
      }
    }
  }
  return planes;
}

std::string text_of(const std::vector<std::byte>& bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

// The codes after the frame's word.
std::vector<int> codes_of(const std::vector<std::byte>& frame, int bits) {
  std::vector<int> codes;
  for (size_t i = 6; i<frame.size(); i += bits> 8 ? 2 : 1) {
    codes.push_back(std::to_integer<int>(frame[i]) |
                    (bits > 8 ? std::to_integer<int>(frame[i + 1]) << 8 : 0));
  }
  return codes;
}

TEST(PipedFrames, AVideoIsWithinHalfACodeOfFloat64) {
  for (const PipeKind kind : {PipeKind::kY4m420, PipeKind::kY4m444}) {
    for (const PipeFormat& format :
         {PipeFormat{kind, 8}, {kind, 10}, {kind, 10, kRec2020Luma}, {kind, 8, kRec709Luma}}) {
      const int bits = format.bits;
      double most = 0;
      for (const auto& [width, height] :
           {std::pair(257, 129), {1, 1}, {1, 2}, {2, 1}, {3, 3}, {64, 2}, {2, 720}}) {
        const Signals signals = random_signals(static_cast<uint32_t>(width), static_cast<uint32_t>(height));
        std::vector<std::byte> frame;
        make_piped_frame(format, signals.picture, frame);
        ASSERT_EQ(text_of(frame).substr(0, 6), "FRAME\n");
        const std::vector<int> codes = codes_of(frame, bits);
        const std::vector<double> exact = twin(signals, format);
        ASSERT_EQ(codes.size(), exact.size()) << width << "x" << height;
        for (size_t i = 0; i < codes.size(); ++i) most = std::max(most, std::fabs(codes[i] - exact[i]));
      }
      // Half a code is the rounding; the codes of 16 bits are the rest.
      EXPECT_LE(most, bits == 8 ? 0.503 : 0.508) << bits;
      RecordProperty((kind == PipeKind::kY4m420 ? "most_420_" : "most_444_") + std::to_string(bits) +
                         (format.matrix ? absl::StrCat("_", format.matrix->code) : ""),
                     std::to_string(most));
      printf("%s, %d bits%s: at most %.4f codes\n", kind == PipeKind::kY4m420 ? "4:2:0" : "4:4:4", bits,
             format.matrix ? absl::StrCat(", ", format.matrix->name).c_str() : "", most);
    }
  }
}

TEST(PipedFrames, TheHeaderSaysWhatTheFramesAre) {
  const FrameRate ntsc{24000, 1001};
  EXPECT_EQ(film_header({PipeKind::kY4m420, 8}, 1920, 1080, 1, ntsc),
            "YUV4MPEG2 W1920 H1080 F24000:1001 Ip A1:1 C420mpeg2 XYSCSS=420MPEG2 XCOLORRANGE=LIMITED\n");
  EXPECT_EQ(film_header({PipeKind::kY4m420, 10}, 31, 17, 1.5, {25, 1}),
            "YUV4MPEG2 W31 H17 F25:1 Ip A3:2 C420p10 XYSCSS=420P10 XCOLORRANGE=LIMITED\n");
  EXPECT_EQ(film_header({PipeKind::kY4m444, 8}, 2, 1, 1, {24, 1}),
            "YUV4MPEG2 W2 H1 F24:1 Ip A1:1 C444 XYSCSS=444 XCOLORRANGE=LIMITED\n");
  EXPECT_EQ(film_header({PipeKind::kY4m444, 10}, 2, 1, 1, {24, 1}),
            "YUV4MPEG2 W2 H1 F24:1 Ip A1:1 C444p10 XYSCSS=444P10 XCOLORRANGE=LIMITED\n");
  EXPECT_EQ(film_header({PipeKind::kPam, 8}, 2, 1, 1, {24, 1}), "");
}

TEST(PipedFrames, BlackAndWhiteAndTheirChromaAreTheStandards) {
  for (const int bits : {8, 10}) {
    const int scale = bits == 8 ? 1 : 4;
    for (const uint16_t code : {uint16_t{0}, uint16_t{65535}}) {
      Image picture = *make_image(4, 4, ImageFormat::kRgba16);
      for (size_t i = 0; i < 64; ++i) std::memcpy(picture.pixels.data() + 2 * i, &code, 2);
      std::vector<std::byte> frame;
      make_piped_frame({PipeKind::kY4m420, bits}, picture, frame);
      const std::vector<int> codes = codes_of(frame, bits);
      ASSERT_EQ(codes.size(), 24u);
      for (size_t i = 0; i < 24; ++i) EXPECT_EQ(codes[i], scale * (i >= 16 ? 128 : code == 0 ? 16 : 235));
    }
  }
}

// 10-bit codes of BT.2020's primary colours, by hand: 64 + 876 K, and 512 + 896 (1 - K) / (2 (1 - K)) = 960
// of the colour's own difference.
TEST(PipedFrames, TheCodesOfRec2020AreTheStandards) {
  const struct {
    uint16_t rgb[3];
    int codes[3];  // luma, Cb, Cr
  } colours[] = {{{65535, 0, 0}, {294, 387, 960}},
                 {{0, 65535, 0}, {658, 189, 100}},
                 {{0, 0, 65535}, {116, 960, 476}},
                 {{65535, 65535, 65535}, {940, 512, 512}}};
  for (const auto& [rgb, codes] : colours) {
    Image picture = *make_image(1, 1, ImageFormat::kRgba16);
    std::memcpy(picture.pixels.data(), rgb, sizeof rgb);
    std::vector<std::byte> frame;
    make_piped_frame({PipeKind::kY4m444, 10, kRec2020Luma}, picture, frame);
    EXPECT_EQ(codes_of(frame, 10), std::vector<int>(std::begin(codes), std::end(codes)));
  }
}

TEST(PipedFrames, PqAndHlgHaveTenBitsAndTheMatrixOfTheirPrimaries) {
  for (const auto transfer : {EncodedTransfer::kPq, EncodedTransfer::kHlg}) {
    for (const int bits : {0, 10}) {
      const PipeFormat wide = pipe_format(PipeKind::kY4m420, bits, transfer, {});
      EXPECT_EQ(wide.bits, 10);
      EXPECT_EQ(wide.matrix->code, kRec2020Luma.code);
      const PipeFormat p3 = pipe_format(PipeKind::kY4m444, bits, transfer, {.p3 = true});
      EXPECT_EQ(p3.bits, 10);
      EXPECT_EQ(p3.matrix->code, kRec709Luma.code);
    }
  }
  const PipeFormat sdr = pipe_format(PipeKind::kY4m420, 0, EncodedTransfer::kSrgb, {});
  EXPECT_EQ(sdr.bits, 8);
  EXPECT_FALSE(sdr.matrix);
  EXPECT_EQ(pipe_format(PipeKind::kY4m420, 10, EncodedTransfer::kSrgb, {}).bits, 10);
}

TEST(PipedFrames, APamHoldsTheCodesAndTheAlpha) {
  Image picture = *make_image(2, 1, ImageFormat::kRgba16);
  const uint16_t codes[] = {0x0102, 0x0304, 0x0506, 0x0708, 9, 10, 11, 12};
  std::memcpy(picture.pixels.data(), codes, sizeof codes);
  std::vector<std::byte> frame;
  make_piped_frame({PipeKind::kPam, 16}, picture, frame);
  EXPECT_EQ(text_of(frame),
            std::string("P7\nWIDTH 2\nHEIGHT 1\nDEPTH 3\nMAXVAL 65535\nTUPLTYPE RGB\nENDHDR\n") +
                std::string("\1\2\3\4\5\6\0\x9\0\xa\0\xb", 12));
  Image small = *make_image(1, 1, ImageFormat::kRgba8);
  std::memcpy(small.pixels.data(), "abcd", 4);
  small.has_alpha = true;
  make_piped_frame({PipeKind::kPam, 8}, small, frame);
  EXPECT_EQ(text_of(frame), "P7\nWIDTH 1\nHEIGHT 1\nDEPTH 4\nMAXVAL 255\nTUPLTYPE RGB_ALPHA\nENDHDR\nabcd");
}

}  // namespace
}  // namespace candela
