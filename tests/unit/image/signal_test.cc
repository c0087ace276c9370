// Signals and their light, and PNG files as input.
#include "client/image/read/signal.h"

#include <OpenEXR/ImfStandardAttributes.h>
#include <OpenEXR/ImfStringAttribute.h>
#include <gtest/gtest.h>
#include <half.h>
#include <png.h>

#include <cmath>
#include <limits>
#include <string>
#include <tuple>
#include <vector>

#include "client/image/color.h"
#include "client/image/power.h"
#include "tests/support/files.h"
#include "tests/support/status.h"
#include "tests/unit/image/exr_reader_fixture.h"
#include "tests/unit/image/image_support.h"
#include "tests/unit/image/png.h"

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

// ITU-T H.273, tables 2 and 3, by hand.
TEST(Signal, EveryCodePointThatMeansSomethingIsRead) {
  const double half_of_srgb = 0.21404114;
  for (const auto& [code, light] : {std::pair(1, half_of_srgb),
                                    {4, std::pow(0.5, 2.2)},
                                    {5, std::pow(0.5, 2.8)},
                                    {6, half_of_srgb},
                                    {7, std::pow(0.6115 / 1.1115, 1 / 0.45)},
                                    {8, 0.5},
                                    {9, 0.1},
                                    {10, std::pow(10, -1.25)},
                                    {11, half_of_srgb},
                                    {12, half_of_srgb},
                                    {13, half_of_srgb},
                                    {14, half_of_srgb},
                                    {15, half_of_srgb},
                                    {17, 52.37 / 48 * std::pow(0.5, 2.6)}}) {
    EXPECT_NEAR(light_of(of_code_points(1, code), 0.5), light, 1e-7) << code;
  }
  EXPECT_NEAR(light_of(of_code_points(1, 7), 0.04), 0.01, 1e-9);
  EXPECT_EQ(light_of(of_code_points(1, 9), 0), 0);
  for (const auto& [code, red, white] : {std::tuple(1, 0.64f, 0.3127f),
                                         {4, 0.67f, 0.310f},
                                         {5, 0.64f, 0.3127f},
                                         {6, 0.63f, 0.3127f},
                                         {7, 0.63f, 0.3127f},
                                         {8, 0.681f, 0.310f},
                                         {9, 0.708f, 0.3127f},
                                         {10, 1.0f, 1 / 3.0f},
                                         {11, 0.68f, 0.314f},
                                         {12, 0.68f, 0.3127f},
                                         {22, 0.63f, 0.3127f}}) {
    EXPECT_EQ(of_code_points(code, 13).xy[0], red) << code;
    EXPECT_EQ(of_code_points(code, 13).xy[6], white) << code;
  }
}

TEST(Signal, TheErrorNamesTheOptionThatHelpsAlone) {
  Signal signal{.transfer = SignalTransfer::kPq};
  EXPECT_REFUSED(kInvalidArgument,
                 "a.png: its cICP has transfer 19, which H.273 gives no meaning; name the transfer with "
                 "--input-transfer",
                 set_code_points("a.png", "cICP", 9, 19, {.own_values = true}, signal));
  EXPECT_EQ(signal.xy[0], 0);  // it stays as it is
  EXPECT_OK(set_code_points("a.png", "cICP", 9, 19, {.transfer = SignalTransfer::kSrgb}, signal));
  EXPECT_EQ(signal.xy[0], 0.708f);
  EXPECT_REFUSED(kInvalidArgument,
                 "a.png: its cICP has primaries 23, which H.273 gives no meaning; name the primaries with "
                 "--primaries",
                 set_code_points("a.png", "cICP", 23, 13, {.transfer = SignalTransfer::kSrgb}, signal));
  EXPECT_OK(set_code_points("a.png", "cICP", 23, 13, {.own_values = true}, signal));
  EXPECT_EQ(signal.transfer, SignalTransfer::kSrgb);
  EXPECT_REFUSED(kInvalidArgument, "its cICP has transfer 3 and primaries 0, which H.273 gives no meaning",
                 set_code_points("a.png", "cICP", 0, 3, {}, signal));
  EXPECT_OK(set_code_points("a.png", "cICP", 0, 3, {.own_values = true, .keeps_signal = true}, signal));
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
    EXPECT_NE(image->light, PictureLight::kHdr) << one.what;
  }
}

TEST(PngReader, KeepsTheAspectOfItsPixels) {
  const std::string wide = chunk("pHYs", big_endian(1000) + big_endian(2000) + std::string(1, '\0'));
  EXPECT_EQ(read_signal(png_of(1, 8, 0, "\x80", wide))->pixel_aspect, 2);
  EXPECT_EQ(read_signal(png_of(1, 8, 0, "\x80"))->pixel_aspect, 1);
}

// Exif of this orientation, from its TIFF header on.
std::string exif_of(char turn) {
  return std::string("MM\0\x2a\0\0\0\x08\0\1\x01\x12\0\3\0\0\0\1\0", 19) + turn + std::string(6, '\0');
}

TEST(PngReader, ItsExifTurnsIt) {
  const std::string aspect = chunk("pHYs", big_endian(1000) + big_endian(2000) + std::string(1, '\0'));
  const auto turned = [&](const std::string& exif) {
    return *read_signal(png_of(3, 8, 0, "\x10\x80\xf0", aspect + exif));
  };
  for (char turn = 1; turn <= 8; ++turn) {
    const Image image = turned(chunk("eXIf", exif_of(turn)));
    EXPECT_EQ(image.width, turn < 5 ? 3u : 1u) << turn;
    EXPECT_EQ(image.height, turn < 5 ? 1u : 3u);
    EXPECT_EQ(image.pixel_aspect, turn < 5 ? 2 : 0.5);
    const bool reversed = turn == 2 || turn == 3 || turn == 7 || turn == 8;
    EXPECT_NEAR(component(image, 0, 0, 0), srgb_light((reversed ? 0xf0 : 0x10) / 255.0), 1e-6) << turn;
  }
  for (const std::string& none : {chunk("eXIf", exif_of(9)), chunk("eXIf", "MM"), chunk("eXIf", "nothing")}) {
    EXPECT_EQ(turned(none).width, 3u);
  }
}

// The checksum of this chunk is wrong.
std::string damaged_chunk(const std::string& name, const std::string& data) {
  std::string bytes = chunk(name, data);
  bytes.back() ^= 1;
  return bytes;
}

TEST(PngReader, AChunkWithAWrongChecksumCountsAsMissing) {
  for (const auto& [name, data] : {std::pair("tEXt", std::string("Comment\0words", 13)),
                                   {"tIME", std::string("\x07\xe8\1\1\1\1\1", 7)},
                                   {"vpAg", std::string("unknown")}}) {
    ASSERT_OK_AND_ASSIGN(const Image image, read_signal(png_of(1, 8, 0, "\x80", damaged_chunk(name, data))));
    EXPECT_NEAR(light_at(image, 0, 0), srgb_light(128 / 255.0), 1e-6) << name;
    EXPECT_TRUE(image.notes.empty()) << name;
  }
  for (const auto& [name, data] : {std::pair("cICP", std::string("\1\x08\0\1", 4)),
                                   {"gAMA", big_endian(100000)},
                                   {"sRGB", std::string(1, '\0')},
                                   {"eXIf", exif_of(6)},
                                   {"pHYs", big_endian(1) + big_endian(2) + std::string(1, '\0')},
                                   {"tRNS", std::string("\0\x80", 2)}}) {
    ASSERT_OK_AND_ASSIGN(const Image image, read_signal(png_of(1, 8, 0, "\x80", damaged_chunk(name, data))));
    EXPECT_NEAR(light_at(image, 0, 0), srgb_light(128 / 255.0), 1e-6) << name;
    EXPECT_EQ(image.signal, "8 bits, sRGB, assumed") << name;
    EXPECT_EQ(image.pixel_aspect, 1);
    EXPECT_FALSE(image.has_alpha);
    ASSERT_EQ(image.notes.size(), 1u) << name;
    EXPECT_EQ(image.notes[0], std::string("its ") + name + " has a wrong checksum and is not used");
  }
  // Those of the pixels are refused.
  const std::string palette = damaged_chunk("PLTE", std::string(6, '\x40'));
  EXPECT_REFUSED(kInvalidArgument, "damaged PNG file: PLTE: CRC error",
                 read_signal(png_of(1, 8, 3, std::string(1, '\1'), palette)));
}

TEST(PngReader, PqIsLightOfADisplayInItsPrimaries) {
  const std::string white = {'\x94', '\xa8'};  // 0.580688881 of 65535
  ASSERT_OK_AND_ASSIGN(const Image pq, read_signal(png_of(1, 16, 0, white, cicp(9, 16))));
  EXPECT_NEAR(light_at(pq, 0, 1), 1, 1e-4);
  EXPECT_EQ(pq.light, PictureLight::kHdr);
  ASSERT_TRUE(pq.chromaticities);
  EXPECT_EQ((*pq.chromaticities)[0], 0.708f);
  // The user's word counts before the file's.
  ASSERT_OK_AND_ASSIGN(const Image srgb, read_signal(png_of(1, 16, 0, white, cicp(9, 16)),
                                                     {.transfer = SignalTransfer::kSrgb}));
  EXPECT_NEAR(light_at(srgb, 0, 1), srgb_light(0x94a8 / 65535.0), 1e-6);
  EXPECT_NE(srgb.light, PictureLight::kHdr);
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
  refused(png_of(70000, 8, 0, std::string(70000, '\0')), "the image is 70000x1 pixels; the limit is");
  const absl::Status small = read_image_bytes("file", good, {.max_pixels = 2}).status();
  EXPECT_TRUE(says(small.message(), "--max-pixels allows 2")) << small;
  EXPECT_TRUE(
      says(read_signal(good, {.layer = "key"}).status().message(), "this is a PNG file with one picture"));
}

// PNG, third edition: what a PNG may not say is not used.
TEST(PngReader, ACicpThatIsNoneIsNotUsed) {
  for (const auto& [bytes, note] :
       {std::pair(cicp(9, 16, 9), "its cICP is not used: it has matrix 9 and range 1; a PNG has matrix 0"),
        {cicp(9, 16, 0, 2), "its cICP is not used: it has matrix 0 and range 2"},
        {chunk("cICP", "abc"), "its cICP is not used: it has 3 bytes, and must have 4"}}) {
    ASSERT_OK_AND_ASSIGN(const Image image, read_signal(png_of(1, 8, 0, "\x80", bytes)));
    EXPECT_TRUE(says(image.notes.front(), note)) << image.notes.front();
    EXPECT_EQ(image.signal, "8 bits, sRGB, assumed");
  }
}

TEST(PngReader, LimitedRangeIsStretched) {
  const auto light = [](int bits, const std::string& row, int full, const PictureChoice& choice) {
    return light_at(*read_signal(png_of(1, bits, 0, row, cicp(1, 8, 0, full)), choice), 0, 0);
  };
  EXPECT_EQ(light(8, "\x10", 0, {}), 0);
  EXPECT_EQ(light(8, "\x05", 0, {}), 0);
  EXPECT_EQ(light(8, "\xeb", 0, {}), 1);
  EXPECT_EQ(light(8, "\xff", 0, {}), 1);
  EXPECT_NEAR(light(8, "\x80", 0, {}), 112 / 219.0, 1e-5);
  EXPECT_NEAR(light(16, std::string("\x80\0", 2), 0, {}), 112 / 219.0, 1e-5);
  EXPECT_NEAR(light(8, "\x80", 0, {.full_range = true}), 128 / 255.0, 1e-5);
  EXPECT_NEAR(light(8, "\x80", 1, {.full_range = false}), 112 / 219.0, 1e-5);
  // Alpha has the full range.
  const std::string half = png_of(1, 8, 4, "\xeb\x80", cicp(1, 8, 0, 0));
  EXPECT_NEAR(light_at(*read_signal(half), 0, 0), 128 / 255.0, 1e-6);
}

// MaxCLL, else the display that the picture was made on, in units of .0001 nit.
TEST(PngReader, SaysHowBrightAPqPictureIs) {
  const std::string pq = cicp(9, 16);
  const auto peak = [&](const std::string& chunks) {
    return read_signal(png_of(1, 8, 0, "\x80", pq + chunks))->peak;
  };
  const std::string display = chunk("mDCV", std::string(16, '\1') + big_endian(40000000) + big_endian(0));
  EXPECT_NEAR(peak(chunk("cLLI", big_endian(6000000) + big_endian(10)) + display), 600 / 203.0, 1e-9);
  EXPECT_NEAR(peak(chunk("cLLI", big_endian(0) + big_endian(0)) + display), 4000 / 203.0, 1e-9);
  EXPECT_NEAR(peak(""), 1000 / 203.0, 1e-9);
  EXPECT_EQ(peak(chunk("cLLI", big_endian(1000000) + big_endian(10))), 1);
  // PQ's own peak says nothing.
  for (const uint32_t most : {100000000u, 0xffffffffu}) {
    const std::string pixels = chunk("cLLI", big_endian(most) + big_endian(10));
    EXPECT_NEAR(peak(pixels), 1000 / 203.0, 1e-9);
    EXPECT_NEAR(peak(pixels + display), 4000 / 203.0, 1e-9);
  }
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

// --input-transfer for files of numbers: OpenEXR, PFM, PHM and Radiance.

constexpr float kInfinity = std::numeric_limits<float>::infinity();
constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

// A PFM of one row: "PF" of R, G, B; "PF4" with alpha.
std::string pfm_row(const std::string& kind, const std::vector<float>& values) {
  const size_t components = kind == "PF4" ? 4 : 3;
  std::string bytes = kind + "\n" + std::to_string(values.size() / components) + " 1\n-1\n";
  bytes.append(reinterpret_cast<const char*>(values.data()), values.size() * sizeof values[0]);
  return bytes;
}

absl::StatusOr<Image> decoded(const std::string& bytes, PictureChoice choice) {
  return read_image_bytes("file", bytes, {}, choice);
}

std::string notes_of(const Image& image) {
  std::string all;
  for (const std::string& note : image.notes) all += note + "\n";
  return all;
}

long double pq(long double v) {
  const long double p = std::pow(v, 32.0L / 2523);
  return 10000 / 203.0L *
         std::pow(std::max(p - 3424.0L / 4096, 0.0L) / (2413.0L / 128 - 2392.0L / 128 * p), 16384.0L / 2610);
}
long double hlg_scene(long double v) {
  return v <= 0.5L ? v * v / 3 : (std::exp((v - 0.55991073L) / 0.17883277L) + 0.28466892L) / 12;
}

TEST(Power, IsThatOfLongDoubles) {
  double most = 0;
  for (const double y : {0.2, 1 / 2.4, 1.8, 2.2, 2.4, 32.0 / 2523, 16384.0 / 2610}) {
    for (double x = 1e-40; x < 1e40; x *= 1.0137) {
      const long double exact = std::pow(static_cast<long double>(x), static_cast<long double>(y));
      most = std::max(most, std::fabs(static_cast<double>(power(x, y) / exact - 1)));
    }
  }
  for (double x = -300; x < 300; x += 0.0437) {
    const long double exact = std::exp(static_cast<long double>(x));
    most = std::max(most, std::fabs(static_cast<double>(exponential(x) / exact - 1)));
  }
  EXPECT_LT(most, 1e-12);
  printf("power and exponential: at most %.3g\n", most);
  EXPECT_EQ(power(1, 2.4), 1);
  EXPECT_EQ(power(0, 2.4), 0);
  EXPECT_EQ(power(kInfinity, 2.4), kInfinity);
  EXPECT_TRUE(std::isnan(power(kNan, 2.4)));
  EXPECT_EQ(power(1e300, 2.4), kInfinity);
  EXPECT_EQ(power(1e-300, 2.4), 0);
  EXPECT_EQ(exponential(-1e9), 0);
  EXPECT_EQ(exponential(1e9), kInfinity);
  EXPECT_TRUE(std::isnan(exponential(kNan)));
  EXPECT_EQ(log2_of(8), 3);
  EXPECT_EQ(log2_of(0x1p-1070), -1070);
  EXPECT_EQ(exponential(-740), std::exp(-740.0));  // denormal
}

TEST(SignalValues, EveryTransferIsWithinAFloatsRounding) {
  std::vector<float> values;
  for (int i = 0; i <= 3000; ++i) values.push_back(static_cast<float>(i) / 3000);
  while (values.size() % 3 != 0) values.push_back(1e-6f * static_cast<float>(values.size()));
  const std::string bytes = pfm_row("PF", values);
  const auto expect = [&](SignalTransfer transfer, auto light) {
    ASSERT_OK_AND_ASSIGN(const Image image, decoded(bytes, {.transfer = transfer}));
    double most = 0;
    for (size_t i = 0; i < values.size(); ++i) {
      const auto exact = static_cast<double>(light(i));
      const double seen = component(image, static_cast<uint32_t>(i / 3), 0, static_cast<int>(i % 3));
      if (exact < 1e-12) {
        EXPECT_NEAR(seen, exact, 1e-18);
      } else {
        most = std::max(most, std::fabs(seen / exact - 1));
      }
    }
    EXPECT_LE(most, 6.1e-8) << static_cast<int>(transfer);
  };
  const auto value = [&](size_t i) { return static_cast<long double>(values[i]); };
  expect(SignalTransfer::kLinear, value);
  expect(SignalTransfer::kGamma, [&](size_t i) { return std::pow(value(i), 2.2L); });
  expect(SignalTransfer::kPq, [&](size_t i) { return pq(value(i)); });
  expect(SignalTransfer::kSrgb, [&](size_t i) {
    return value(i) <= 0.04045L ? value(i) / 12.92L : std::pow((value(i) + 0.055L) / 1.055L, 2.4L);
  });
  // A file without primaries is Rec.2020, whose luminance is that of BT.2100 to 1e-4: 0.2627, 0.6780, 0.0593.
  const double r = 0.262700212, g = 0.677998072, b = 0.0593017165;
  expect(SignalTransfer::kHlg, [&](size_t i) {
    const size_t first = i - i % 3;
    const long double y =
        r * hlg_scene(value(first)) + g * hlg_scene(value(first + 1)) + b * hlg_scene(value(first + 2));
    return y > 0 ? 1000 / 203.0L * std::pow(y, 0.2L) * hlg_scene(value(i)) : 0.0L;
  });
}

TEST(SignalValues, PqAndHlgAreLightOfADisplay) {
  for (const auto transfer : {SignalTransfer::kPq, SignalTransfer::kHlg}) {
    ASSERT_OK_AND_ASSIGN(const Image image,
                         decoded(pfm_row("PF", {0.5f, 0.5f, 0.5f}), {.transfer = transfer}));
    EXPECT_EQ(image.light, PictureLight::kHdr);
    EXPECT_FALSE(image.names_primaries);
    EXPECT_EQ((*image.chromaticities)[0], 0.708f);
    EXPECT_TRUE(says(notes_of(image), ": 1 is reference white, 203 nit"));
    EXPECT_FALSE(absl::StrContains(notes_of(image), "were cut"));
    ASSERT_OK_AND_ASSIGN(const Image own,
                         decoded(pfm_row("PF", {0.5f, 0, 1}), {.own_values = true, .transfer = transfer}));
    EXPECT_FALSE(own.chromaticities);
    EXPECT_FALSE(own.names_primaries);
  }
  ASSERT_OK_AND_ASSIGN(const Image srgb,
                       decoded(pfm_row("PF", {0.5f, 0, 1}), {.transfer = SignalTransfer::kSrgb}));
  EXPECT_NE(srgb.light, PictureLight::kHdr);
  EXPECT_FALSE(srgb.names_primaries);
  EXPECT_EQ(notes_of(srgb), "");
  // --ocio-input takes the values as they are.
  ASSERT_OK_AND_ASSIGN(const Image kept,
                       decoded(pfm_row("PF", {0.5f, -1, 2}),
                               {.own_values = true, .transfer = SignalTransfer::kPq, .keeps_signal = true}));
  EXPECT_EQ(component(kept, 0, 0, 0), 0.5f);
  EXPECT_EQ(component(kept, 0, 0, 2), 2);
  EXPECT_NE(kept.light, PictureLight::kHdr);
}

TEST(SignalValues, WhatIsNoSignalIsCutWithANote) {
  const std::string bytes = pfm_row("PF", {-0.5f, 1.5f, 1, kInfinity, -kInfinity, -0.0f, kNan, 0.5f, 1});
  for (const auto transfer : {SignalTransfer::kPq, SignalTransfer::kHlg}) {
    ASSERT_OK_AND_ASSIGN(const Image image, decoded(bytes, {.transfer = transfer}));
    const float white = component(image, 0, 0, 2);
    EXPECT_EQ(component(image, 0, 0, 0), 0);
    EXPECT_EQ(component(image, 0, 0, 1), white);
    EXPECT_GT(component(image, 1, 0, 0), 1);
    EXPECT_TRUE(std::isfinite(component(image, 1, 0, 0)));
    EXPECT_EQ(component(image, 1, 0, 1), 0);
    EXPECT_EQ(component(image, 1, 0, 2), 0);
    EXPECT_TRUE(std::isnan(component(image, 2, 0, 0)));  // --bad-values decides
    EXPECT_GT(component(image, 2, 0, 1), 0);
    EXPECT_TRUE(says(notes_of(image), ": values below 0 or above 1 are no signal, and were cut"));
  }
  // The curves of a scene go on.
  ASSERT_OK_AND_ASSIGN(const Image srgb, decoded(bytes, {.transfer = SignalTransfer::kSrgb}));
  EXPECT_FLOAT_EQ(component(srgb, 0, 0, 0), -0.5f / 12.92f);
  EXPECT_FLOAT_EQ(component(srgb, 0, 0, 1), static_cast<float>(std::pow(1.555 / 1.055, 2.4)));
  EXPECT_EQ(component(srgb, 1, 0, 0), kInfinity);
  EXPECT_TRUE(std::isnan(component(srgb, 2, 0, 0)));
  ASSERT_OK_AND_ASSIGN(const Image gamma, decoded(bytes, {.transfer = SignalTransfer::kGamma}));
  EXPECT_FLOAT_EQ(component(gamma, 0, 0, 0), -static_cast<float>(std::pow(0.5, 2.2)));
  EXPECT_EQ(component(gamma, 1, 0, 1), -kInfinity);
  EXPECT_EQ(notes_of(gamma), "");
}

TEST(SignalValues, ColourIsDividedByAlphaBefore) {
  const float white = 0.580688881f;
  ASSERT_OK_AND_ASSIGN(const Image image,
                       decoded(pfm_row("PF4", {white, 0.25f * white, 0, 1,     //
                                               0.25f * white, 0, 0.5f, 0.25f,  // 0.5 / 0.25 is above 1
                                               white, 0, 0, 0, white, 0, 0, kInfinity}),
                               {.transfer = SignalTransfer::kPq}));
  EXPECT_NEAR(component(image, 0, 0, 0), 1, 1e-6);
  EXPECT_NEAR(component(image, 1, 0, 0), 0.25, 1e-6);
  EXPECT_FLOAT_EQ(component(image, 1, 0, 2), 0.25f * 10000 / 203);
  EXPECT_NEAR(component(image, 2, 0, 0), 1, 1e-6);
  EXPECT_NEAR(component(image, 3, 0, 0), 1, 1e-6);
  EXPECT_EQ(component(image, 1, 0, 3), 0.25f);
  EXPECT_TRUE(image.has_alpha);
}

TEST(SignalValues, HalvesAndRadianceBecomeTheirLight) {
  std::string phm = "PH\n1 1\n-1\n";
  for (const float v : {0.5f, 0.25f, 1.0f}) {
    const uint16_t bits = half(v).bits();
    phm.append(reinterpret_cast<const char*>(&bits), sizeof bits);
  }
  ASSERT_OK_AND_ASSIGN(const Image image, decoded(phm, {.transfer = SignalTransfer::kGamma}));
  EXPECT_EQ(image.format, ImageFormat::kRgba32f);
  EXPECT_FLOAT_EQ(component(image, 0, 0, 1), static_cast<float>(std::pow(0.25, 2.2)));
  ASSERT_OK_AND_ASSIGN(const Image same, decoded(phm, {.transfer = SignalTransfer::kLinear}));
  EXPECT_EQ(same.format, ImageFormat::kRgba16f);
  // As halves it fits, as floats it does not.
  const absl::Status status =
      read_image_bytes("file", phm, {.max_bytes = 8}, {.transfer = SignalTransfer::kPq}).status();
  EXPECT_TRUE(says(status.message(), "file: the image is 1x1 pixels of 16 bytes; the limit is 8 bytes"));
  EXPECT_OK(read_image_bytes("file", phm, {.max_bytes = 8}).status());

  const std::string hdr =
      "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 1\n" + std::string("\x80\x40\x20\x80", 4);
  ASSERT_OK_AND_ASSIGN(const Image radiance, decoded(hdr, {.transfer = SignalTransfer::kPq}));
  EXPECT_NEAR(component(radiance, 0, 0, 0), static_cast<double>(pq(0.5L)), 1e-6);
  EXPECT_EQ(radiance.light, PictureLight::kHdr);
  // X and Z of CIE XYZ have no luminance.
  std::string xyz = hdr;
  xyz.replace(xyz.find("rgbe"), 4, "xyze");
  ASSERT_OK_AND_ASSIGN(const Image light, decoded(xyz, {.transfer = SignalTransfer::kHlg}));
  const auto y = static_cast<double>(hlg_scene(0.25L));
  EXPECT_NEAR(component(light, 0, 0, 1), 1000 / 203.0 * std::pow(y, 1.2), 1e-6);
}

class ExrSignals : public ExrReader {
 protected:
  absl::StatusOr<Image> read_named(const std::string& id, PictureChoice choice) {
    Imf::Header header(2, 1);
    if (!id.empty()) header.insert("colorInteropID", Imf::StringAttribute(id));
    write_scan_lines(path_, header,
                     {{"R", Imf::HALF, [](int, int) { return 0.5; }},
                      {"G", Imf::HALF, [](int, int) { return 0.25; }},
                      {"B", Imf::HALF, [](int, int) { return 0.125; }}});
    return read_image(path_, {}, choice);
  }
};

TEST_F(ExrSignals, TheUsersTransferCountsAndTheFilesPrimaries) {
  for (const auto& [id, red] : {std::pair("pq_p3d65_display", 0.68f),
                                {"srgb_ap1_scene", 0.713f},
                                {"lin_ap1_scene", 0.713f},
                                {"hlg_rec2020_display", 0.708f},
                                {"studio:pq_p3d65_display", 0.708f},
                                {"g26_xyzd65_display", 0.708f},
                                {"", 0.708f}}) {
    ASSERT_OK_AND_ASSIGN(const Image image, read_named(id, {.transfer = SignalTransfer::kPq}));
    EXPECT_EQ(image.format, ImageFormat::kRgba32f);
    EXPECT_NEAR(component(image, 0, 0, 1), static_cast<double>(pq(0.25L)), 1e-7) << id;
    EXPECT_EQ((*image.chromaticities)[0], red) << id;
    EXPECT_EQ(image.light, PictureLight::kHdr);
    EXPECT_FALSE(absl::StrContains(notes_of(image), "decoded from")) << notes_of(image);
  }
  ASSERT_OK_AND_ASSIGN(const Image linear,
                       read_named("srgb_ap1_scene", {.transfer = SignalTransfer::kLinear}));
  EXPECT_EQ(component(linear, 0, 0, 1), 0.25f);
  EXPECT_EQ((*linear.chromaticities)[0], 0.713f);
  ASSERT_OK_AND_ASSIGN(const Image unknown,
                       read_named("g26_xyzd65_display", {.transfer = SignalTransfer::kGamma}));
  EXPECT_FALSE(unknown.names_primaries);
  EXPECT_TRUE(says(notes_of(unknown), "its colorInteropID, \"g26_xyzd65_display\", is not used: no public"));
  ASSERT_OK_AND_ASSIGN(const Image own,
                       read_named("pq_p3d65_display", {.own_values = true, .transfer = SignalTransfer::kPq}));
  EXPECT_FALSE(own.chromaticities);
  EXPECT_NEAR(component(own, 0, 0, 1), static_cast<double>(pq(0.25L)), 1e-7);
  EXPECT_TRUE(says(read_named("pq_p3d65_display", {}).status().message(),
                   "the signal of a display; name its curve with --input-transfer, such as pq"));
  const absl::Status large = read_image(path_, {.max_bytes = 16}, {.transfer = SignalTransfer::kPq}).status();
  EXPECT_TRUE(says(large.message(), "2x1 pixels of 16 bytes; the limit is 16 bytes"));
}

}  // namespace
}  // namespace candela
