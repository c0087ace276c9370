// AVIF files as input.
#include <avif/avif.h>
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <functional>
#include <string>
#include <vector>

#include "client/image/read/signal.h"
#include "tests/support/files.h"
#include "tests/support/status.h"
#include "tests/unit/image/image_support.h"
#include "tests/unit/image/png.h"

namespace candela {
namespace {

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
  ASSERT_OK_AND_ASSIGN(const Image image, read_signal(bytes));
  EXPECT_EQ(image.width, 17u);
  EXPECT_EQ(image.height, 9u);
  EXPECT_EQ(image.signal, "10 bits, PQ, from nclx");
  EXPECT_EQ(image.light, PictureLight::kHdr);
  const Signal pq = of_code_points(9, 16);
  for (uint32_t y = 0; y < 9; ++y) {
    for (uint32_t x = 0; x < 17; ++x) {
      const std::array<int, 3> code = some_code(x, y);
      const std::array<double, 3> expected = nits(pq, {code[0] / 1023.0, code[1] / 1023.0, code[2] / 1023.0});
      for (size_t k = 0; k < 3; ++k) {
        ASSERT_NEAR(light_at(image, y * 17 + x, k) * 203, expected[k], 3e-4 * expected[k])
            << x << " " << y << " " << k;
      }
    }
  }
}

// A viewer turns and mirrors what the file says.
TEST(AvifReader, IsUpright) {
  const auto turned = [](int angle, int mirror) {
    return *read_signal(avif_of(17, 9, some_code, [&](avifImage& image) {
      if (angle > 0) image.transformFlags |= AVIF_TRANSFORM_IROT;
      image.irot.angle = static_cast<uint8_t>(angle);
      if (mirror >= 0) image.transformFlags |= AVIF_TRANSFORM_IMIR;
      image.imir.mode = static_cast<uint8_t>(std::max(mirror, 0));
    }));
  };
  const Image plain = turned(0, -1);
  const auto of = [](const Image& image, uint32_t x, uint32_t y) {
    return light_at(image, y * image.width + x, 0);
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

// The part that is to be seen (clap) is cut out first, then turned.
TEST(AvifReader, IsCropped) {
  const auto cropped = [](const avifCropRect& rect, int angle, uint32_t width_d = 1) {
    return read_signal(avif_of(17, 9, some_code, [&](avifImage& image) {
      image.transformFlags |= AVIF_TRANSFORM_CLAP | AVIF_TRANSFORM_IROT;
      avifDiagnostics why;
      EXPECT_TRUE(
          avifCleanApertureBoxConvertCropRect(&image.clap, &rect, 17, 9, AVIF_PIXEL_FORMAT_YUV444, &why));
      image.clap.widthD = width_d;
      image.irot.angle = static_cast<uint8_t>(angle);
    }));
  };
  ASSERT_OK_AND_ASSIGN(const Image plain, read_signal(avif_of(17, 9, some_code, [](avifImage&) {})));
  const auto of = [](const Image& image, uint32_t x, uint32_t y) {
    return light_at(image, y * image.width + x, 0);
  };
  ASSERT_OK_AND_ASSIGN(const Image part, cropped({3, 2, 7, 5}, 0));
  EXPECT_EQ(part.width, 7u);
  EXPECT_EQ(part.height, 5u);
  for (uint32_t y = 0; y < 5; ++y) {
    for (uint32_t x = 0; x < 7; ++x) EXPECT_EQ(of(part, x, y), of(plain, x + 3, y + 2)) << x << ' ' << y;
  }
  ASSERT_OK_AND_ASSIGN(const Image turned, cropped({3, 2, 7, 5}, 1));
  EXPECT_EQ(turned.width, 5u);
  EXPECT_EQ(of(turned, 0, 0), of(plain, 9, 2));
  EXPECT_EQ(of(turned, 4, 6), of(plain, 3, 6));
  ASSERT_OK_AND_ASSIGN(const Image strange, cropped({3, 2, 7, 5}, 0, 2));  // 3.5 pixels
  EXPECT_EQ(strange.width, 17u);
  EXPECT_TRUE(says(strange.notes.front(), "its cropping is not applied: "));
}

TEST(AvifReader, KeepsTheAspectOfItsPixels) {
  const auto aspect = [](uint32_t across, uint32_t down, int angle) {
    return *read_signal(avif_of(2, 1, some_code, [&](avifImage& image) {
      image.transformFlags |= AVIF_TRANSFORM_PASP | AVIF_TRANSFORM_IROT;
      image.pasp = {across, down};
      image.irot.angle = static_cast<uint8_t>(angle);
    }));
  };
  EXPECT_EQ(aspect(2, 1, 0).pixel_aspect, 2);
  EXPECT_EQ(aspect(4, 3, 2).pixel_aspect, 4 / 3.0);
  EXPECT_EQ(aspect(2, 1, 1).pixel_aspect, 0.5);  // turned with the picture
  EXPECT_EQ(aspect(2, 1, 3).pixel_aspect, 0.5);
  for (const Image& strange : {aspect(0, 1, 0), aspect(1, 0, 0), aspect(0, 0, 1)}) {
    EXPECT_EQ(strange.pixel_aspect, 1);
    EXPECT_TRUE(says(strange.notes.front(), "is not within 0.01 .. 100 and was ignored"));
  }
}

TEST(AvifReader, GammaIsRead) {
  const std::string gamma = avif_of(2, 1, some_code, [](avifImage& image) {
    image.colorPrimaries = AVIF_COLOR_PRIMARIES_BT709;
    image.transferCharacteristics = AVIF_TRANSFER_CHARACTERISTICS_BT470M;
  });
  ASSERT_OK_AND_ASSIGN(const Image image, read_signal(gamma));
  EXPECT_EQ(image.signal, "10 bits, gamma 2.2, from nclx");
  EXPECT_NEAR(light_at(image, 0, 0), std::pow(100 / 1023.0, 2.2), 1e-6);
}

// The user's matrix and range count before the file's.
TEST(AvifReader, MatrixAndRangeAreTheUsers) {
  const auto light = [](const std::string& file, const PictureChoice& choice, size_t c) {
    const absl::StatusOr<Image> image = read_signal(file, choice);
    EXPECT_OK(image.status());
    return image.ok() ? light_at(*image, 0, c) : -1;
  };
  // Y 500, Cb 600, Cr 400.
  const auto with_matrix = [](int code) {
    return avif_of(
        2, 1,
        [](uint32_t, uint32_t) {
          return std::array{400, 500, 600};
        },
        [code](avifImage& image) {
          image.colorPrimaries = AVIF_COLOR_PRIMARIES_BT709;
          image.transferCharacteristics = AVIF_TRANSFER_CHARACTERISTICS_LINEAR;
          image.matrixCoefficients = static_cast<avifMatrixCoefficients>(code);
        });
  };
  const double y = 500 / 1023.0, cb = (600 - 512) / 1023.0;
  EXPECT_NEAR(light(with_matrix(6), {}, 2), y + 1.772 * cb, 1e-4);
  EXPECT_NEAR(light(with_matrix(6), {.matrix = 1}, 2), y + 1.8556 * cb, 1e-4);
  EXPECT_NEAR(light(with_matrix(1), {.full_range = false}, 2),
              (500 - 64) / 876.0 + 1.8556 * (600 - 512) / 896.0, 1e-3);
  for (const int code : {3, 14, 15}) {  // ICtCp, and numbers without a meaning
    EXPECT_TRUE(says(read_signal(with_matrix(code)).status().message(),
                     absl::StrCat("file: its luma and chroma have matrix ", code,
                                  " of H.273 in YUV444 planes, which cannot be read; name another one with "
                                  "--input-matrix")));
    EXPECT_NEAR(light(with_matrix(code), {.matrix = 9}, 2), y + 1.8814 * cb, 1e-4);
  }
}

// ISO/IEC 14496-12's boxes, which this libavif does not write.
TEST(AvifReader, SaysHowBrightAPqPictureIs) {
  const std::string file = avif_of(2, 1, some_code, [](avifImage&) {});
  const std::string light = big_endian(12) + "clli" + std::string("\x02\x58\0\x0a", 4);
  const std::string display =
      big_endian(32) + "mdcv" + std::string(16, '\1') + big_endian(40000000) + big_endian(0);
  const auto with = [&file](const std::string& boxes) {
    return file + big_endian(static_cast<uint32_t>(8 + boxes.size())) + "free" + boxes;
  };
  EXPECT_NEAR(read_signal(file)->peak, 1000 / 203.0, 1e-9);
  EXPECT_NEAR(read_signal(with(light + display))->peak, 600 / 203.0, 1e-9);
  EXPECT_NEAR(read_signal(with(display))->peak, 4000 / 203.0, 1e-9);
}

TEST(AvifReader, AGainMapIsNoted) {
  std::string bytes = avif_of(2, 1, some_code, [](avifImage&) {});
  EXPECT_TRUE(read_signal(bytes)->notes.size() == 1) << read_signal(bytes)->notes.back();  // of PQ
  ASSERT_OK_AND_ASSIGN(const Image apple, read_signal(bytes + big_endian(44) + "meta" + std::string(4, '\0') +
                                                      "aux:hdrgainmap" + std::string(18, '\0')));
  EXPECT_EQ(apple.notes.front(), "its gain map is not used: the picture without it is shown");
  bytes.replace(bytes.find("miaf"), 4, "tmap");
  ASSERT_OK_AND_ASSIGN(const Image iso, read_signal(bytes));
  EXPECT_EQ(iso.notes.front(), "its gain map is not used: the picture without it is shown");
  EXPECT_TRUE(iso.has_gain_map);
  ASSERT_OK_AND_ASSIGN(const Image base, read_signal(bytes, {.base_of_gain_map = true}));
  EXPECT_EQ(base.notes.size(), 1u) << base.notes.front();
}

TEST(AvifReader, WhatCannotBeReadIsNamed) {
  const std::string good = avif_of(17, 9, some_code, [](avifImage&) {});
  for (size_t size = 12; size < good.size(); size += good.size() / 20) {
    const absl::Status status = read_signal(good.substr(0, size)).status();
    EXPECT_TRUE(says(status.message(), "file: damaged AVIF file: ")) << size << " " << status;
  }
  const std::string strange = avif_of(17, 9, some_code, [](avifImage& image) {
    image.transferCharacteristics = static_cast<avifTransferCharacteristics>(19);
  });
  EXPECT_TRUE(says(read_signal(strange).status().message(),
                   "file: its nclx has transfer 19, which H.273 gives no meaning; name the transfer with"));
  EXPECT_OK(read_signal(strange, {.transfer = SignalTransfer::kPq}));
  EXPECT_TRUE(says(read_image_bytes("file", good, {.max_pixels = 100}).status().message(),
                   "--max-pixels allows 100"));
}

}  // namespace
}  // namespace candela
