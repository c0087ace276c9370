// Signals and their light, and PNG files as input.
#include "client/image/read/signal.h"

#include <gtest/gtest.h>
#include <png.h>

#include <cmath>
#include <string>
#include <tuple>
#include <vector>

#include "client/image/color.h"
#include "tests/support/files.h"
#include "tests/support/status.h"
#include "tests/unit/image/image_support.h"
#include "tests/unit/image/png_bytes.h"
#include "tests/unit/image/signal_support.h"

namespace candela {
namespace {

// SMPTE ST 2084, ITU-R BT.2408. Each is of the nearest code of 16 bits.
TEST(Signal, PqHasItsPublishedValues) {
  const Signal pq = of_code_points(9, 16);
  for (const auto& [signal, expected] : {std::pair(7.30955903e-7, 0.0),
                                         {0.149945732, 1.0},
                                         {0.508078421517, 100.0},
                                         {0.580688881042, 203.0},
                                         {0.751827096247, 1000.0},
                                         {0.902572393311, 4000.0},
                                         {1.0, 10000.0}}) {
    for (const double nit : nits(pq, {signal, signal, signal})) EXPECT_NEAR(nit, expected, 1e-4 * expected);
  }
}

// ITU-R BT.2100, with the system gamma of the display's peak.
TEST(Signal, HlgHasItsPublishedValues) {
  const Signal hlg = of_code_points(9, 18);
  const auto near = [](const std::array<double, 3>& seen, const std::array<double, 3>& expected) {
    for (size_t k = 0; k < 3; ++k) EXPECT_NEAR(seen[k], expected[k], 1e-4 * expected[k]);
  };
  near(nits(hlg, {0.75, 0.75, 0.75}), {203.152, 203.152, 203.152});
  near(nits(hlg, {0.75, 0.5, 0.25}), {175.46004, 55.18391, 13.79598});
  near(nits(hlg, {1, 1, 1}), {1000, 1000, 1000});
  near(nits(hlg, {1, 1, 1}, {.hlg_peak = 400}), {400, 400, 400});
  // 0.75 is 0.2650 of the scene; the gamma of 2000 nit is 1.326432598.
  const double half = 2000 * std::pow(0.26496256, 1.326432598);
  near(nits(hlg, {0.75, 0.75, 0.75}, {.hlg_peak = 2000}), {half, half, half});
  near(nits(hlg, {0, 0, 0}), {0, 0, 0});
  // The user's primaries weigh it: Rec.709's blue has 0.0722 of white's luminance.
  near(nits(hlg, {0, 0, 1}, {.primaries = kRec709.xy}), {0, 0, 1000 * std::pow(0.07219232, 0.2)});
  near(nits(hlg, {0, 0, 1}), {0, 0, 1000 * std::pow(0.05930172, 0.2)});
}

TEST(Signal, OtherCodePointsAreRefusedByName) {
  Signal signal{.source = "cICP"};
  EXPECT_REFUSED(kInvalidArgument,
                 "a.png: its cICP is transfer 11 of H.273; Candela reads 1, "
                 "4, 8, 13, 16 and 18; name another with --input-transfer",
                 set_code_points("a.png", 1, 11, signal));
  EXPECT_REFUSED(kInvalidArgument, "a.png: its cICP is primaries 5 of H.273; Candela reads 1, 9 and 12",
                 set_code_points("a.png", 5, 13, signal));
}

TEST(Signal, IsThatOfAKnownProfile) {
  for (const auto& [profile, transfer, red] : {std::tuple("sRGB IEC61966-2.1", SignalTransfer::kSrgb, 0.64f),
                                               {"Display P3", SignalTransfer::kSrgb, 0.68f},
                                               {"ITU-R BT.2100 PQ", SignalTransfer::kPq, 0.708f},
                                               {"Rec2100 HLG", SignalTransfer::kHlg, 0.708f}}) {
    Signal signal;
    EXPECT_TRUE(set_by_profile_name(profile, signal)) << profile;
    EXPECT_EQ(signal.transfer, transfer) << profile;
    EXPECT_EQ(signal.xy[0], red) << profile;
  }
  Signal signal;
  EXPECT_FALSE(set_by_profile_name("Canon MP500 series", signal));
}

// ---- PNG ----

double srgb_light(double v) { return v <= 0.04045 ? v / 12.92 : std::pow((v + 0.055) / 1.055, 2.4); }

TEST(PngReader, EveryKindOfPixelIsItsLight) {
  const double grey = srgb_light(128 / 255.0);
  struct Case {
    const char* what;
    std::string bytes;
    std::array<double, 4> light;
    const char* signal;
  };
  const std::string palette = chunk("PLTE", {'\0', '\0', '\0', '\x80', '\xff', '\0'});
  for (const Case& one : {
           Case{"grey 8", png_of(1, 8, 0, "\x80"), {grey, grey, grey, 1}, "8 bits, sRGB, assumed"},
           Case{"grey 16", png_of(1, 16, 0, "\x80\x80"), {grey, grey, grey, 1}, "16 bits, sRGB, assumed"},
           Case{"grey and alpha",
                png_of(1, 8, 4, "\x80\x33"),
                {grey / 5, grey / 5, grey / 5, 0.2},
                "8 bits, sRGB, assumed"},
           Case{"one bit", png_of(1, 1, 0, "\x80"), {1, 1, 1, 1}, "1 bits, sRGB, assumed"},
           Case{"rgb", png_of(1, 8, 2, {'\xff', '\x80', '\0'}), {1, grey, 0, 1}, "8 bits, sRGB, assumed"},
           Case{"rgba",
                png_of(1, 8, 6, {'\xff', '\x80', '\0', '\x33'}),
                {0.2, grey / 5, 0, 0.2},
                "8 bits, sRGB, assumed"},
           Case{"palette", png_of(1, 8, 3, "\x01", palette), {grey, 1, 0, 1}, "8 bits, sRGB, assumed"},
           Case{"palette with alpha",
                png_of(1, 8, 3, "\x01", palette + chunk("tRNS", {'\xff', '\x33'})),
                {grey / 5, 0.2, 0, 0.2},
                "8 bits, sRGB, assumed"},
           Case{"sRGB chunk",
                png_of(1, 8, 0, "\x80", chunk("sRGB", std::string(1, '\0'))),
                {grey, grey, grey, 1},
                "8 bits, sRGB, from sRGB"},
           Case{"linear",
                png_of(1, 8, 0, "\x80", chunk("gAMA", big_endian(100000))),
                {128 / 255.0, 128 / 255.0, 128 / 255.0, 1},
                "8 bits, linear, from gAMA"},
           Case{"gamma",
                png_of(1, 8, 0, "\x80", chunk("gAMA", big_endian(50000))),
                {std::pow(128 / 255.0, 2), std::pow(128 / 255.0, 2), std::pow(128 / 255.0, 2), 1},
                "8 bits, gamma 2, from gAMA"},
           Case{"cICP over sRGB",
                png_of(1, 8, 0, "\x80", cicp(1, 8) + chunk("sRGB", std::string(1, '\0'))),
                {128 / 255.0, 128 / 255.0, 128 / 255.0, 1},
                "8 bits, linear, from cICP"},
       }) {
    const absl::StatusOr<Image> image = read_signal(one.bytes);
    ASSERT_OK(image) << one.what;
    for (size_t k = 0; k < 4; ++k)
      EXPECT_NEAR(light_at(*image, 0, k), one.light[k], 1e-6) << one.what << " " << k;
    EXPECT_EQ(image->has_alpha, one.light[3] != 1) << one.what;
    EXPECT_EQ(image->signal, one.signal) << one.what;
    EXPECT_FALSE(image->display_light) << one.what;
  }
}

TEST(PngReader, KeepsTheAspectOfItsPixels) {
  const std::string wide = chunk("pHYs", big_endian(1000) + big_endian(2000) + std::string(1, '\0'));
  EXPECT_EQ(read_signal(png_of(1, 8, 0, "\x80", wide))->pixel_aspect, 2);
  EXPECT_EQ(read_signal(png_of(1, 8, 0, "\x80"))->pixel_aspect, 1);
}

TEST(PngReader, PqIsLightOfADisplayInItsPrimaries) {
  const std::string white = {'\x94', '\xa8'};  // 0.580688881 of 65535
  ASSERT_OK_AND_ASSIGN(const Image pq, read_signal(png_of(1, 16, 0, white, cicp(9, 16))));
  EXPECT_NEAR(light_at(pq, 0, 1), 1, 1e-4);
  EXPECT_TRUE(pq.display_light);
  ASSERT_TRUE(pq.chromaticities);
  EXPECT_EQ((*pq.chromaticities)[0], 0.708f);
  // The user's word counts before the file's.
  ASSERT_OK_AND_ASSIGN(const Image srgb, read_signal(png_of(1, 16, 0, white, cicp(9, 16)),
                                                     {.transfer = SignalTransfer::kSrgb}));
  EXPECT_NEAR(light_at(srgb, 0, 1), srgb_light(0x94a8 / 65535.0), 1e-6);
  EXPECT_FALSE(srgb.display_light);
  ASSERT_OK_AND_ASSIGN(const Image own,
                       read_signal(png_of(1, 16, 0, white, cicp(9, 16)), {.own_values = true}));
  EXPECT_FALSE(own.chromaticities);
  EXPECT_NEAR(light_at(own, 0, 1), 1, 1e-4);
  ASSERT_OK_AND_ASSIGN(const Image codes, read_signal(png_of(1, 16, 0, white, cicp(9, 16)),
                                                      {.own_values = true, .keeps_signal = true}));
  EXPECT_NEAR(light_at(codes, 0, 1), 0x94a8 / 65535.0, 1e-6);
}

TEST(PngReader, WhatCannotBeReadIsNamed) {
  const std::string good = png_of(3, 8, 2, std::string(9, '\x40'));
  const auto refused = [](const std::string& bytes, const std::string& words) {
    const absl::Status status = read_signal(bytes).status();
    EXPECT_TRUE(says(status.message(), words)) << status;
  };
  ASSERT_OK(read_signal(good));
  refused(good.substr(0, good.size() - 20), "damaged PNG file: the file is truncated");
  refused(good.substr(0, 20), "damaged PNG file: the file is truncated");
  std::string crc = good;
  crc[20] ^= 1;
  refused(crc, "damaged PNG file: IHDR: CRC error");
  std::string bad_tag = png_of(1, 8, 0, "\x80", cicp(9, 16));
  bad_tag[bad_tag.find("cICP") + 5] ^= 2;
  refused(bad_tag, "damaged PNG file: cICP: CRC error");
  refused(png_of(1, 8, 0, "\x80", cicp(9, 16, 9)),
          "its cICP has matrix 9 and range 1; Candela reads matrix 0");
  refused(png_of(1, 8, 0, "\x80", cicp(9, 16, 0, 0)), "range 0");
  refused(png_of(1, 8, 0, "\x80", chunk("cICP", "abc")), "its cICP has 3 bytes; it must have 4");
  refused(png_of(70000, 8, 0, std::string(70000, '\0')), "the image is 70000x1 pixels; the limit is");
  const absl::Status small = read_image_bytes("file", good, {.max_pixels = 2}).status();
  EXPECT_TRUE(says(small.message(), "--max-pixels allows 2")) << small;
  EXPECT_TRUE(
      says(read_signal(good, {.layer = "key"}).status().message(), "this is a PNG file with one picture"));
}

// All seven passes make a row.
TEST(PngReader, AnInterlacedPictureIsWhole) {
  constexpr uint32_t kWidth = 13, kHeight = 11;
  std::string bytes;
  png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, nullptr, nullptr, nullptr);
  png_infop info = png_create_info_struct(png);
  png_set_write_fn(
      png, &bytes,
      [](png_structp to, png_bytep data, size_t size) {
        static_cast<std::string*>(png_get_io_ptr(to))->append(reinterpret_cast<const char*>(data), size);
      },
      nullptr);
  png_set_IHDR(png, info, kWidth, kHeight, 8, PNG_COLOR_TYPE_GRAY, PNG_INTERLACE_ADAM7,
               PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
  png_write_info(png, info);
  std::vector<std::vector<png_byte>> rows(kHeight, std::vector<png_byte>(kWidth));
  std::vector<png_bytep> pointers;
  for (uint32_t y = 0; y < kHeight; ++y) {
    for (uint32_t x = 0; x < kWidth; ++x) rows[y][x] = static_cast<png_byte>(17 * y + x);
    pointers.push_back(rows[y].data());
  }
  png_write_image(png, pointers.data());
  png_write_end(png, info);
  png_destroy_write_struct(&png, &info);
  ASSERT_OK_AND_ASSIGN(const Image image, read_signal(bytes));
  for (uint32_t y = 0; y < kHeight; ++y) {
    for (uint32_t x = 0; x < kWidth; ++x) {
      EXPECT_NEAR(light_at(image, y * kWidth + x, 0), srgb_light((17 * y + x) / 255.0), 1e-6);
    }
  }
  EXPECT_TRUE(
      says(read_signal(bytes.substr(0, bytes.size() / 2)).status().message(), "the file is truncated"));
}

}  // namespace
}  // namespace candela
