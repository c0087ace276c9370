// PNG and AVIF files as input: what their codes are in light.
#include "client/image/read/signal.h"

#include <avif/avif.h>
#include <gtest/gtest.h>
#include <png.h>

#include <cmath>
#include <functional>
#include <string>
#include <tuple>
#include <vector>

#include "client/image/primaries.h"
#include "tests/support/files.h"
#include "tests/support/status.h"
#include "tests/unit/image/image_support.h"
#include "tests/unit/image/png_bytes.h"

namespace candela {
namespace {

uint16_t code_of(double signal) { return static_cast<uint16_t>(std::lround(signal * 65535)); }

// The light of a signal, in nit of reference white 203, for R, G, B.
std::array<double, 3> nits(const Signal& signal, std::array<double, 3> v, const PictureChoice& choice = {}) {
  const std::array<uint16_t, 4> codes = {code_of(v[0]), code_of(v[1]), code_of(v[2]), 65535};
  float light[4];
  SignalDecoder(signal, choice).decode(codes, light);
  return {light[0] * 203.0, light[1] * 203.0, light[2] * 203.0};
}

Signal of_code_points(int primaries, int transfer) {
  Signal signal;
  EXPECT_OK(set_code_points("file", primaries, transfer, signal));
  return signal;
}

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
  EXPECT_REFUSED(
      kInvalidArgument,
      "a.png: its cICP is transfer 11 of H.273; Candela reads 1, 8, 13, 16 and 18; name another with "
      "--input-transfer",
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

absl::StatusOr<Image> read(const std::string& bytes, const PictureChoice& choice = {}) {
  return read_image_bytes("file", bytes, {}, choice);
}

float at(const Image& image, uint32_t x, size_t component) {
  float v;
  std::memcpy(&v, image.pixels.data() + x * 16 + component * 4, sizeof v);
  return v;
}

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
    const absl::StatusOr<Image> image = read(one.bytes);
    ASSERT_OK(image) << one.what;
    for (size_t k = 0; k < 4; ++k) EXPECT_NEAR(at(*image, 0, k), one.light[k], 1e-6) << one.what << " " << k;
    EXPECT_EQ(image->has_alpha, one.light[3] != 1) << one.what;
    EXPECT_EQ(image->signal, one.signal) << one.what;
    EXPECT_FALSE(image->display_light) << one.what;
  }
}

TEST(PngReader, KeepsTheAspectOfItsPixels) {
  const std::string wide = chunk("pHYs", big_endian(1000) + big_endian(2000) + std::string(1, '\0'));
  EXPECT_EQ(read(png_of(1, 8, 0, "\x80", wide))->pixel_aspect, 2);
  EXPECT_EQ(read(png_of(1, 8, 0, "\x80"))->pixel_aspect, 1);
}

TEST(PngReader, PqIsLightOfADisplayInItsPrimaries) {
  const std::string white = {'\x94', '\xa8'};  // 0.580688881 of 65535
  ASSERT_OK_AND_ASSIGN(const Image pq, read(png_of(1, 16, 0, white, cicp(9, 16))));
  EXPECT_NEAR(at(pq, 0, 1), 1, 1e-4);
  EXPECT_TRUE(pq.display_light);
  ASSERT_TRUE(pq.chromaticities);
  EXPECT_EQ((*pq.chromaticities)[0], 0.708f);
  // The user's word counts before the file's.
  ASSERT_OK_AND_ASSIGN(const Image srgb,
                       read(png_of(1, 16, 0, white, cicp(9, 16)), {.transfer = SignalTransfer::kSrgb}));
  EXPECT_NEAR(at(srgb, 0, 1), srgb_light(0x94a8 / 65535.0), 1e-6);
  EXPECT_FALSE(srgb.display_light);
  ASSERT_OK_AND_ASSIGN(const Image own, read(png_of(1, 16, 0, white, cicp(9, 16)), {.own_values = true}));
  EXPECT_FALSE(own.chromaticities);
  EXPECT_NEAR(at(own, 0, 1), 1, 1e-4);
  ASSERT_OK_AND_ASSIGN(const Image codes, read(png_of(1, 16, 0, white, cicp(9, 16)),
                                               {.own_values = true, .keeps_signal = true}));
  EXPECT_NEAR(at(codes, 0, 1), 0x94a8 / 65535.0, 1e-6);
}

TEST(PngReader, WhatCannotBeReadIsNamed) {
  const std::string good = png_of(3, 8, 2, std::string(9, '\x40'));
  const auto refused = [](const std::string& bytes, const std::string& words) {
    const absl::Status status = read(bytes).status();
    EXPECT_TRUE(says(status.message(), words)) << status;
  };
  ASSERT_OK(read(good));
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
  EXPECT_TRUE(says(read(good, {.layer = "key"}).status().message(), "this is a PNG file with one picture"));
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
  ASSERT_OK_AND_ASSIGN(const Image image, read(bytes));
  for (uint32_t y = 0; y < kHeight; ++y) {
    for (uint32_t x = 0; x < kWidth; ++x) {
      EXPECT_NEAR(at(image, y * kWidth + x, 0), srgb_light((17 * y + x) / 255.0), 1e-6);
    }
  }
  EXPECT_TRUE(says(read(bytes.substr(0, bytes.size() / 2)).status().message(), "the file is truncated"));
}

// ---- AVIF ----

// A lossless picture of 10 bits, each pixel R, G, B from `codes`.
std::string avif_of(uint32_t width, uint32_t height,
                    const std::function<std::array<int, 3>(uint32_t, uint32_t)>& codes,
                    const std::function<void(avifImage&)>& change) {
  avifImage* const image =
      avifImageCreate(static_cast<int>(width), static_cast<int>(height), 10, AVIF_PIXEL_FORMAT_YUV444);
  image->yuvRange = AVIF_RANGE_FULL;
  image->matrixCoefficients = AVIF_MATRIX_COEFFICIENTS_IDENTITY;
  image->colorPrimaries = AVIF_COLOR_PRIMARIES_BT2020;
  image->transferCharacteristics = AVIF_TRANSFER_CHARACTERISTICS_SMPTE2084;
  change(*image);
  avifImageAllocatePlanes(image, AVIF_PLANES_YUV);
  for (uint32_t y = 0; y < height; ++y) {
    for (uint32_t x = 0; x < width; ++x) {
      const std::array<int, 3> rgb = codes(x, y);
      for (const auto& [plane, k] : {std::pair(AVIF_CHAN_Y, 1), {AVIF_CHAN_U, 2}, {AVIF_CHAN_V, 0}}) {
        reinterpret_cast<uint16_t*>(image->yuvPlanes[plane] + y * image->yuvRowBytes[plane])[x] =
            static_cast<uint16_t>(rgb[k]);
      }
    }
  }
  avifEncoder* const encoder = avifEncoderCreate();
  encoder->minQuantizer = encoder->maxQuantizer = AVIF_QUANTIZER_LOSSLESS;
  encoder->speed = 8;
  avifRWData data = AVIF_DATA_EMPTY;
  EXPECT_EQ(avifEncoderWrite(encoder, image, &data), AVIF_RESULT_OK);
  std::string bytes(reinterpret_cast<const char*>(data.data), data.size);
  avifRWDataFree(&data);
  avifEncoderDestroy(encoder);
  avifImageDestroy(image);
  return bytes;
}
std::array<int, 3> some_code(uint32_t x, uint32_t y) {
  return {static_cast<int>(100 + 40 * x), static_cast<int>(594 + y), static_cast<int>(900 - 7 * x * y)};
}

TEST(AvifReader, EveryPixelIsItsLight) {
  const std::string bytes = avif_of(17, 9, some_code, [](avifImage&) {});
  ASSERT_OK_AND_ASSIGN(const Image image, read(bytes));
  EXPECT_EQ(image.width, 17u);
  EXPECT_EQ(image.height, 9u);
  EXPECT_EQ(image.signal, "10 bits, PQ, from nclx");
  EXPECT_TRUE(image.display_light);
  const Signal pq = of_code_points(9, 16);
  for (uint32_t y = 0; y < 9; ++y) {
    for (uint32_t x = 0; x < 17; ++x) {
      const std::array<int, 3> code = some_code(x, y);
      const std::array<double, 3> expected = nits(pq, {code[0] / 1023.0, code[1] / 1023.0, code[2] / 1023.0});
      for (size_t k = 0; k < 3; ++k) {
        ASSERT_NEAR(at(image, y * 17 + x, k) * 203, expected[k], 3e-4 * expected[k])
            << x << " " << y << " " << k;
      }
    }
  }
}

// A viewer turns and mirrors what the file says.
TEST(AvifReader, IsUpright) {
  const auto turned = [](int angle, int mirror) {
    return *read(avif_of(17, 9, some_code, [&](avifImage& image) {
      if (angle > 0) image.transformFlags |= AVIF_TRANSFORM_IROT;
      image.irot.angle = static_cast<uint8_t>(angle);
      if (mirror >= 0) image.transformFlags |= AVIF_TRANSFORM_IMIR;
      image.imir.mode = static_cast<uint8_t>(std::max(mirror, 0));
    }));
  };
  const Image plain = turned(0, -1);
  const auto of = [](const Image& image, uint32_t x, uint32_t y) {
    return at(image, y * image.width + x, 0);
  };
  const Image left = turned(1, -1);  // a quarter turn counterclockwise: the right edge is on top
  EXPECT_EQ(left.width, 9u);
  EXPECT_EQ(of(left, 2, 0), of(plain, 16, 2));
  EXPECT_EQ(of(left, 0, 16), of(plain, 0, 0));
  EXPECT_EQ(of(turned(2, -1), 0, 0), of(plain, 16, 8));
  const Image right = turned(3, -1);
  EXPECT_EQ(of(right, 8, 0), of(plain, 0, 0));
  EXPECT_EQ(of(turned(0, 0), 3, 0), of(plain, 3, 8));
  EXPECT_EQ(of(turned(0, 1), 0, 4), of(plain, 16, 4));
}

TEST(AvifReader, WhatCannotBeReadIsNamed) {
  const std::string good = avif_of(17, 9, some_code, [](avifImage&) {});
  for (size_t size = 12; size < good.size(); size += good.size() / 20) {
    const absl::Status status = read(good.substr(0, size)).status();
    EXPECT_TRUE(says(status.message(), "file: damaged AVIF file: ")) << size << " " << status;
  }
  const std::string strange = avif_of(17, 9, some_code, [](avifImage& image) {
    image.transferCharacteristics = AVIF_TRANSFER_CHARACTERISTICS_LOG100;
  });
  EXPECT_TRUE(
      says(read(strange).status().message(), "file: its nclx is transfer 9 of H.273; Candela reads 1, 8,"));
  EXPECT_OK(read(strange, {.own_values = true, .transfer = SignalTransfer::kPq}));
  EXPECT_TRUE(says(read_image_bytes("file", good, {.max_pixels = 100}).status().message(),
                   "--max-pixels allows 100"));
}

}  // namespace
}  // namespace candela
