// Pictures in PQ and HLG as PNG and AVIF files, and AVIF files of other pictures.
#include <avif/avif.h>
#include <gtest/gtest.h>
#include <zlib.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "client/image/write/encodings.h"
#include "client/image/write/writers.h"
#include "tests/support/files.h"
#include "tests/support/status.h"
#include "tests/unit/image/image_support.h"
#include "tests/unit/image/png.h"

namespace candela {
namespace {

// Slow waves of each component, with the corners of the cube in the first row.
Image waves(uint32_t width, uint32_t height, bool alpha) {
  Image image = *make_image(width, height, ImageFormat::kRgba16);
  image.has_alpha = alpha;
  for (uint32_t y = 0; y < height; ++y) {
    for (uint32_t x = 0; x < width; ++x) {
      for (uint32_t c = 0; c < 4; ++c) {
        const bool corner = y == 0 && x < 8 && c < 3;
        const double wave = .5 + .5 * std::sin(.05 * (c + 1) * x + .07 * y + c);
        const auto code = static_cast<uint16_t>(corner ? (x >> c & 1) * 65535 : std::lround(65535 * wave));
        std::memcpy(image.pixels.data() + y * image.row_bytes() + size_t{8} * x + size_t{2} * c, &code, 2);
      }
    }
  }
  return image;
}

uint32_t number_at(const std::string& bytes, size_t at, size_t count) {
  uint32_t value = 0;
  for (size_t i = 0; i < count; ++i) value = value << 8 | static_cast<uint8_t>(bytes.at(at + i));
  return value;
}

// The chunks before the pixels by their kinds. A checksum that is wrong fails the test.
std::map<std::string, std::string> chunks_in(const std::string& png) {
  std::map<std::string, std::string> chunks;
  for (size_t at = 8; at + 12 <= png.size();) {
    const uint32_t size = number_at(png, at, 4);
    const std::string body = png.substr(at + 4, size_t{4} + size), kind = body.substr(0, 4);
    if (kind == "IDAT") break;
    const uLong sum = crc32(0, reinterpret_cast<const Bytef*>(body.data()), static_cast<uInt>(body.size()));
    EXPECT_EQ(number_at(png, at + 8 + size, 4), sum) << kind;
    EXPECT_EQ(chunks.count(kind), 0u) << kind;
    chunks[kind] = body.substr(4);
    at += 12 + size;
  }
  return chunks;
}

std::vector<uint32_t> numbers_of(const std::string& bytes, const std::vector<size_t>& sizes) {
  std::vector<uint32_t> numbers;
  size_t at = 0;
  for (const size_t size : sizes) {
    numbers.push_back(number_at(bytes, at, size));
    at += size;
  }
  EXPECT_EQ(at, bytes.size());
  return numbers;
}

struct FreeDecoder {
  void operator()(avifDecoder* decoder) const { avifDecoderDestroy(decoder); }
};

class HdrFiles : public ::testing::Test {
 protected:
  std::string write(const std::string& name, const Image& image, const WriteOptions& options) {
    EXPECT_OK(write_image(folder_.path(name), image, options));
    return read_file(folder_.path(name));
  }
  absl::Status refused(const std::string& name, const Image& image, const WriteOptions& options) {
    absl::Status status = write_image(folder_.path(name), image, options).status();
    EXPECT_TRUE(folder_.list().empty());
    return status;
  }
  // Decodes a file by libavif; what it holds is decoder->image.
  std::unique_ptr<avifDecoder, FreeDecoder> decoded(const std::string& bytes) {
    std::unique_ptr<avifDecoder, FreeDecoder> decoder(avifDecoderCreate());
    avifDecoderSetIOMemory(decoder.get(), reinterpret_cast<const uint8_t*>(bytes.data()), bytes.size());
    EXPECT_EQ(avifDecoderParse(decoder.get()), AVIF_RESULT_OK) << decoder->diag.error;
    EXPECT_EQ(avifDecoderNextImage(decoder.get()), AVIF_RESULT_OK) << decoder->diag.error;
    return decoder;
  }
  // How far the codes in a file are from those of the picture, in codes of 10 bits. A reader multiplies
  // colour by alpha.
  double most_off(const std::string& name, const Image& image) {
    const auto back =
        read_image(folder_.path(name), {},
                   {.own_values = true, .transfer = SignalTransfer::kGamma, .keeps_signal = true});
    EXPECT_OK(back);
    EXPECT_EQ(back->has_alpha, image.has_alpha);
    double most = 0;
    for (uint32_t y = 0; y < image.height; ++y) {
      for (uint32_t x = 0; x < image.width; ++x) {
        const double alpha = image.has_alpha ? component(image, x, y, 3) / 65535 : 1;
        for (int c = 0; c < (image.has_alpha ? 4 : 3); ++c) {
          const double code = component(image, x, y, c) / 65535 * (c < 3 ? alpha : 1);
          most = std::max(most, 1023 * std::fabs(component(*back, x, y, c) - code));
        }
      }
    }
    return most;
  }

  TemporaryFolder folder_;
};

// The numbers are the examples of PNG, third edition, and of SMPTE ST 2086.
TEST_F(HdrFiles, APngSaysItsSignalAndItsDisplay) {
  const Image image = waves(9, 5, true);
  for (const bool p3 : {false, true}) {
    for (const auto transfer : {EncodedTransfer::kPq, EncodedTransfer::kHlg}) {
      const std::string file = write(
          "a.png", image,
          {.transfer = transfer,
           .hdr = {.p3 = p3, .peak_nits = 4000, .max_light_nits = 1000.5, .mean_light_nits = 99.98765}});
      const auto chunks = chunks_in(file);
      const uint32_t code = transfer == EncodedTransfer::kPq ? 16 : 18;
      EXPECT_EQ(numbers_of(chunks.at("cICP"), {1, 1, 1, 1}),
                (std::vector<uint32_t>{p3 ? 12u : 9u, code, 0, 1}));
      const std::vector<uint32_t> display =
          p3 ? std::vector<uint32_t>{34000, 16000, 13250, 34500, 7500, 3000, 15635, 16450, 40000000, 0}
             : std::vector<uint32_t>{35400, 14600, 8500, 39850, 6550, 2300, 15635, 16450, 40000000, 0};
      EXPECT_EQ(numbers_of(chunks.at("mDCV"), {2, 2, 2, 2, 2, 2, 2, 2, 4, 4}), display);
      EXPECT_EQ(numbers_of(chunks.at("cLLI"), {4, 4}), (std::vector<uint32_t>{10005000, 999877}));
      EXPECT_EQ(chunks.size(), 4u);  // and IHDR: no sRGB, gAMA or cHRM
      EXPECT_LE(most_off("a.png", image), 1e-3);
      ASSERT_OK_AND_ASSIGN(const Image read, read_image(folder_.path("a.png")));
      EXPECT_TRUE(says(read.signal, transfer == EncodedTransfer::kPq ? "16 bits, PQ" : "16 bits, HLG"));
      EXPECT_NEAR(read.chromaticities->front(), p3 ? .680 : .708, 1e-4);
    }
  }
}

TEST_F(HdrFiles, APngWithoutLightLevelsHasNoChunkOfThem) {
  const auto chunks = chunks_in(write("a.png", waves(3, 2, false), {.transfer = EncodedTransfer::kPq}));
  EXPECT_EQ(chunks.count("cLLI"), 0u);
  EXPECT_EQ(number_at(chunks.at("mDCV"), 16, 4), 10000000u);  // 1000 nit
}

TEST_F(HdrFiles, AnSdrPngHasNoWordOfThem) {
  for (const auto transfer : {EncodedTransfer::kSrgb, EncodedTransfer::kGamma22, EncodedTransfer::kLinear,
                              EncodedTransfer::kUnknown}) {
    const auto chunks = chunks_in(write("a.png", waves(3, 2, false), {.transfer = transfer}));
    for (const char* kind : {"cICP", "mDCV", "cLLI"}) EXPECT_EQ(chunks.count(kind), 0u) << kind;
  }
}

TEST_F(HdrFiles, AnAvifHoldsTenBitsOfFullColourAndSaysItsSignal) {
  struct Case {
    EncodedTransfer transfer;
    bool p3;
    int primaries, code, matrix;
  };
  for (const Case& made :
       {Case{EncodedTransfer::kPq, false, 9, 16, 9}, Case{EncodedTransfer::kPq, true, 12, 16, 1},
        Case{EncodedTransfer::kHlg, false, 9, 18, 9}, Case{EncodedTransfer::kHlg, true, 12, 18, 1},
        Case{EncodedTransfer::kSrgb, false, 1, 13, 1}, Case{EncodedTransfer::kLinear, false, 1, 8, 1},
        Case{EncodedTransfer::kGamma22, false, 1, 4, 1}, Case{EncodedTransfer::kUnknown, false, 2, 2, 1}}) {
    for (const bool alpha : {false, true}) {
      SCOPED_TRACE(::testing::Message() << made.primaries << " " << made.code << " alpha " << alpha);
      Image image = waves(70, 41, alpha);
      image.pixel_aspect = alpha ? 1.5 : 1;
      const std::string file =
          write("a.avif", image, {.transfer = made.transfer, .hdr = {.p3 = made.p3}, .jpeg_quality = 100});
      const auto decoder = decoded(file);
      const avifImage& held = *decoder->image;
      EXPECT_EQ(held.width, 70u);
      EXPECT_EQ(held.height, 41u);
      EXPECT_EQ(held.depth, 10u);
      EXPECT_EQ(held.yuvFormat, AVIF_PIXEL_FORMAT_YUV444);
      EXPECT_EQ(held.yuvRange, AVIF_RANGE_FULL);
      EXPECT_EQ(held.colorPrimaries, made.primaries);
      EXPECT_EQ(held.transferCharacteristics, made.code);
      EXPECT_EQ(held.matrixCoefficients, made.matrix);
      EXPECT_EQ(held.alphaPlane != nullptr, alpha);
      EXPECT_EQ(held.alphaPremultiplied, AVIF_FALSE);
      EXPECT_EQ(held.transformFlags, alpha ? AVIF_TRANSFORM_PASP : AVIF_TRANSFORM_NONE);
      if (alpha) {
        EXPECT_EQ(held.pasp.hSpacing, 3u);
        EXPECT_EQ(held.pasp.vSpacing, 2u);
      }
      // Y, Cb and Cr of 10 bits are each within half a code, and B is Y + 1.8814 Cb.
      const double most = most_off("a.avif", image);
      EXPECT_LE(most, 2);
      RecordProperty("most_" + std::to_string(made.primaries) + "_" + std::to_string(made.code),
                     std::to_string(most));
    }
  }
}

TEST_F(HdrFiles, AnAvifOfAnySizeComesBack) {
  for (const auto& [width, height] : {std::pair(1, 1), {2, 1}, {1, 9}, {65, 3}, {7, 130}}) {
    const Image image = waves(static_cast<uint32_t>(width), static_cast<uint32_t>(height), height > 8);
    const std::string file = write("a.avif", image, {.transfer = EncodedTransfer::kHlg, .jpeg_quality = 100});
    EXPECT_EQ(decoded(file)->image->width, image.width);
    EXPECT_EQ(decoded(file)->image->height, image.height);
    EXPECT_LE(most_off("a.avif", image), 2) << width << "x" << height;
  }
}

TEST_F(HdrFiles, AnAvifInPqIsReadAsTheLightOfItsDisplay) {
  // A grey of 203 nit, which is reference white, has the PQ code .5807 (ITU-R BT.2408).
  Image image = *make_image(16, 16, ImageFormat::kRgba16);
  const auto code = static_cast<uint16_t>(std::lround(.5807 * 65535));
  for (size_t i = 0; i < size_t{4} * 256; ++i) std::memcpy(image.pixels.data() + 2 * i, &code, 2);
  write("a.avif", image, {.transfer = EncodedTransfer::kPq});
  ASSERT_OK_AND_ASSIGN(const Image back, read_image(folder_.path("a.avif")));
  EXPECT_EQ(back.light, PictureLight::kHdr);
  EXPECT_TRUE(says(back.signal, "10 bits, PQ"));
  EXPECT_NEAR(back.chromaticities->front(), .708, 1e-4);
  for (int c = 0; c < 3; ++c) EXPECT_NEAR(component(back, 8, 8, c), 1, .01);
}

TEST_F(HdrFiles, AnAvifSaysThatItsColourIsMultipliedByAlpha) {
  const std::string file = write("a.avif", waves(8, 8, true), {.associated_alpha = true});
  EXPECT_EQ(decoded(file)->image->alphaPremultiplied, AVIF_TRUE);
}

TEST_F(HdrFiles, ALowerQualityMakesASmallerAvif) {
  const Image image = waves(200, 120, false);
  size_t last = std::numeric_limits<size_t>::max();
  double off = 0;
  for (const int quality : {100, 92, 60, 1}) {
    const std::string file =
        write("a.avif", image, {.transfer = EncodedTransfer::kPq, .jpeg_quality = quality});
    EXPECT_LT(file.size(), last) << quality;
    const double most = most_off("a.avif", image);
    EXPECT_GT(most, off) << quality;
    last = file.size();
    off = most;
  }
}

TEST_F(HdrFiles, TheNumberOfThreadsDoesNotChangeAnAvif) {
  const Image image = waves(400, 200, true);
  const auto bytes_with = [&image](int threads) {
    std::string bytes;
    EXPECT_OK(encode_avif(image, {.transfer = EncodedTransfer::kPq}, threads,
                          [&bytes](const void* from, size_t count) {
                            bytes.append(static_cast<const char*>(from), count);
                            return true;
                          }));
    return bytes;
  };
  const std::string one = bytes_with(1);
  EXPECT_GT(one.size(), 1000u);
  for (const int threads : {1, 2, 5}) EXPECT_TRUE(bytes_with(threads) == one) << threads;
}

TEST_F(HdrFiles, AnAvifWithoutASinkSaysSo) {
  const absl::Status status =
      encode_avif(waves(4, 4, false), {}, 1, [](const void*, size_t) { return false; });
  EXPECT_EQ(status.message(), "cannot encode the AVIF: write failed");
}

TEST_F(HdrFiles, AFileWithoutAWordForThemRefuses) {
  for (const auto transfer : {EncodedTransfer::kPq, EncodedTransfer::kHlg}) {
    EXPECT_REFUSED(kInvalidArgument, "TIFF has no word for PQ or HLG; write .png or .avif",
                   refused("a.tif", waves(2, 2, false), {.transfer = transfer}));
    EXPECT_REFUSED(kInvalidArgument, "JPEG has no word for PQ or HLG; write .png or .avif",
                   refused("a.jpg", *make_image(2, 2, ImageFormat::kRgba8), {.transfer = transfer}));
  }
}

TEST_F(HdrFiles, WrongOptionsAreRefused) {
  const Image image = waves(2, 2, false);
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN(), kInfinity = INFINITY;
  for (const char* name : {"a.png", "a.avif"}) {
    for (const double peak : {0.0, -1.0, 10001.0, kNan, kInfinity}) {
      EXPECT_REFUSED(kInvalidArgument, "the display's peak is",
                     refused(name, image, {.transfer = EncodedTransfer::kPq, .hdr = {.peak_nits = peak}}));
    }
    for (const double light : {-1.0, 10001.0, kNan, kInfinity}) {
      for (const HdrDisplay& hdr :
           {HdrDisplay{.max_light_nits = light}, HdrDisplay{.mean_light_nits = light}}) {
        EXPECT_REFUSED(kInvalidArgument, "the picture's light is",
                       refused(name, image, {.transfer = EncodedTransfer::kHlg, .hdr = hdr}));
      }
    }
  }
  EXPECT_REFUSED(
      kInvalidArgument, "codes of 16 bits, and this one is rgba8",
      refused("a.png", *make_image(2, 2, ImageFormat::kRgba8), {.transfer = EncodedTransfer::kPq}));
  for (const int quality : {0, 101, -5}) {
    EXPECT_REFUSED(kInvalidArgument, "AVIF quality", refused("a.avif", image, {.jpeg_quality = quality}));
  }
  EXPECT_REFUSED(kInvalidArgument, "AVIF is written from rgba16, not rgba8",
                 refused("a.avif", *make_image(2, 2, ImageFormat::kRgba8), {}));
}

}  // namespace
}  // namespace candela
