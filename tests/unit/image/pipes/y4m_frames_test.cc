#include "client/image/read/y4m_frames.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <cstring>
#include <string>
#include <thread>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "client/image/color.h"
#include "client/image/read/image_stream.h"
#include "client/image/write/piped_frames.h"
#include "tests/support/files.h"
#include "tests/support/status.h"
#include "tests/unit/image/image_support.h"

namespace candela {
namespace {

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
          const PipeFormat format{kind, bits, rec2020};
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
                                                     bytes_of(one.codes, one.bits)));
    for (int c = 0; c < 3; ++c) EXPECT_NEAR(component(image, 0, 0, c), one.rgb[c], 4e-3) << one.words << c;
  }
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
    return (component(*image, x, y, 0) - 110 / 219.0) * 224 / (2 * (1 - .2126)) + 128;
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
  EXPECT_TRUE(pq.display_light);
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

}  // namespace
}  // namespace candela
