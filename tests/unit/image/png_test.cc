// The pixels of PNG files, read back by libpng: it checks every chunk's checksum, and zlib that of the rows.
#include <gtest/gtest.h>
#include <hwy/highway.h>
#include <hwy/targets.h>
#include <png.h>
#include <zlib.h>

#include <cstring>
#include <new>
#include <random>
#include <string>
#include <vector>

#include "server/encode/picture.h"
#include "tests/support/status.h"

namespace candela {
namespace {

enum class Kind { kFlat, kNoise, kRamp, kNoiseInPlaces, kSteep };

struct Sample {
  PictureView view;
  std::vector<std::byte> rows;
};

Sample sample(uint32_t width, uint32_t height, bool wide, Kind kind, uint32_t padding, uint32_t seed) {
  std::mt19937 random(seed);
  Sample made;
  made.view = {.width = width, .height = height, .wide = wide};
  made.view.row_stride_bytes = size_t{width} * (wide ? 8 : 4) + padding;
  made.rows.resize(made.view.row_stride_bytes * height);
  for (size_t i = 0; i < made.rows.size(); ++i) {
    made.rows[i] = static_cast<std::byte>(kind == Kind::kFlat    ? 7
                                          : kind == Kind::kNoise ? random()
                                          : kind == Kind::kRamp  ? i / 64 + i % 4 * 9
                                          : kind == Kind::kSteep ? random() % 2 * 255
                                          : i % 5000 < 500       ? random()
                                                                 : i / 999);
  }
  made.view.rows = made.rows.data();
  return made;
}

std::string encoded_png(const PictureView& view, bool alpha, uint32_t threads) {
  std::string file;
  EXPECT_OK(encode_png(view, {.alpha = alpha, .threads = threads}, [&file](const void* bytes, size_t count) {
    file.append(static_cast<const char*>(bytes), count);
    return true;
  }));
  return file;
}

struct Reading {
  const std::string& file;
  size_t at = 0;
};

void read_on(png_structp png, png_bytep to, size_t count) {
  auto* reading = static_cast<Reading*>(png_get_io_ptr(png));
  if (count > reading->file.size() - reading->at) png_error(png, "the file is short");
  std::memcpy(to, reading->file.data() + reading->at, count);
  reading->at += count;
}

// libpng only warns of some faults.
void fail(png_structp, png_const_charp message) {
  ADD_FAILURE() << message;
  throw 1;
}

void expect_holds(const std::string& file, const PictureView& view, bool alpha) {
  Reading reading{file};
  png_structp png = png_create_read_struct(PNG_LIBPNG_VER_STRING, nullptr, fail, fail);
  png_infop info = png_create_info_struct(png);
  png_set_read_fn(png, &reading, read_on);
  png_read_info(png, info);
  ASSERT_EQ(png_get_image_width(png, info), view.width);
  ASSERT_EQ(png_get_image_height(png, info), view.height);
  ASSERT_EQ(png_get_bit_depth(png, info), view.wide ? 16 : 8);
  ASSERT_EQ(png_get_channels(png, info), alpha ? 4 : 3);
  if (view.wide) png_set_swap(png);
  const size_t component = view.wide ? 2 : 1;
  const size_t kept = component * (alpha ? 4 : 3);
  std::vector<png_byte> row(view.width * kept);
  for (uint32_t y = 0; y < view.height; ++y) {
    png_read_row(png, row.data(), nullptr);
    for (size_t x = 0; x < view.width; ++x) {
      ASSERT_EQ(std::memcmp(&row[x * kept], view.row(y) + x * 4 * component, kept), 0) << x << ", " << y;
    }
  }
  png_read_end(png, info);
  EXPECT_EQ(reading.at, file.size());
  png_destroy_read_struct(&png, &info, nullptr);
}

uint32_t number_in(const std::string& file, size_t at) {
  uint32_t value = 0;
  for (size_t i = 0; i < 4; ++i) value = value << 8 | static_cast<uint8_t>(file[at + i]);
  return value;
}

// What the IDAT chunks hold together.
std::string stream_of(const std::string& file, int* chunks = nullptr) {
  std::string stream;
  for (size_t at = 8; at < file.size(); at += 12 + number_in(file, at)) {
    if (file.compare(at + 4, 4, "IDAT") != 0) continue;
    stream += file.substr(at + 8, number_in(file, at));
    if (chunks != nullptr) ++*chunks;
  }
  return stream;
}

// libpng does not read the stream's end, where its checksum is.
void expect_whole_stream(const std::string& file, const PictureView& view, bool alpha) {
  const std::string stream = stream_of(file);
  uLongf bytes = (size_t{view.width} * (alpha ? 4 : 3) * (view.wide ? 2 : 1) + 1) * view.height;
  std::vector<Bytef> rows(bytes);
  uLong used = stream.size();
  EXPECT_EQ(uncompress2(rows.data(), &bytes, reinterpret_cast<const Bytef*>(stream.data()), &used), Z_OK);
  EXPECT_EQ(bytes, rows.size());
  EXPECT_EQ(used, stream.size());
}

void expect_round_trip(const PictureView& view, bool alpha, uint32_t threads) {
  const std::string file = encoded_png(view, alpha, threads);
  expect_holds(file, view, alpha);
  expect_whole_stream(file, view, alpha);
}

TEST(PngPixels, EverySmallSizeComesBack) {
  for (uint32_t width = 1; width <= 70; ++width) {
    for (uint32_t height = 1; height <= 5; ++height) {
      for (const int kind : {0, 1, 2, 3}) {
        const bool wide = kind & 1, alpha = kind & 2;
        const Sample made = sample(width, height, wide, Kind::kNoiseInPlaces, 0, width * height);
        ASSERT_NO_FATAL_FAILURE(expect_round_trip(made.view, alpha, 1)) << width << "x" << height;
      }
    }
  }
}

TEST(PngPixels, PicturesOfEveryKindComeBack) {
  std::mt19937 random(1);
  for (int i = 0; i < 300; ++i) {
    const uint32_t width = 1 + random() % (i % 10 == 0 ? 5000 : 150);
    const uint32_t height = 1 + random() % (i % 7 == 0 ? 400 : 40);
    const auto kind = static_cast<Kind>(random() % 5);
    const bool wide = random() % 2, alpha = random() % 2;
    const Sample made = sample(width, height, wide, kind, random() % 3 * 64, i);
    ASSERT_NO_FATAL_FAILURE(expect_round_trip(made.view, alpha, random() % 4)) << width << "x" << height;
  }
}

TEST(PngPixels, ARowLongerThanAStripeComesBack) {
  const Sample made = sample(100000, 3, true, Kind::kNoise, 0, 1);
  expect_round_trip(made.view, true, 2);
}

// One of several stripes.
Sample large() { return sample(1000, 700, false, Kind::kNoiseInPlaces, 0, 5); }

TEST(PngPixels, TheNumberOfThreadsDoesNotChangeTheFile) {
  const Sample made = large();
  const std::string one = encoded_png(made.view, false, 1);
  int chunks = 0;
  stream_of(one, &chunks);
  EXPECT_GT(chunks, 4);
  for (const uint32_t threads : {0u, 2u, 3u, 16u, 100u})
    EXPECT_EQ(encoded_png(made.view, false, threads), one);
}

#ifdef __x86_64__
// isa-l and Highway choose instructions by the processor, so the checksum is a record. Another version of
// isa-l may need another one.
TEST(PngPixels, TheProcessorDoesNotChangeTheFile) {
  if (!__builtin_cpu_supports("sse4.2")) GTEST_SKIP() << "isa-l finds other runs without SSE4.2";
  const Sample made = large();
  const Sample wide = sample(333, 200, true, Kind::kRamp, 0, 5);
  constexpr int64_t kPlain = HWY_SCALAR | HWY_EMU128;
  const int64_t compiled = HWY_TARGETS & (kPlain | HWY_SSE4 | HWY_AVX2 | HWY_AVX3);
  for (int64_t rest = (hwy::SupportedTargets() | kPlain) & compiled; rest != 0; rest &= rest - 1) {
    const int64_t target = rest & -rest;
    hwy::SetSupportedTargetsForTest(target);
    hwy::GetChosenTarget().Update(target);
    const std::string files = encoded_png(made.view, false, 1) + encoded_png(wide.view, true, 1);
    EXPECT_EQ(crc32(0, reinterpret_cast<const Bytef*>(files.data()), static_cast<uInt>(files.size())),
              3532565110u)
        << hwy::TargetName(target);
  }
  hwy::SetSupportedTargetsForTest(0);
  hwy::GetChosenTarget().Update(hwy::SupportedTargets());
}
#endif

TEST(PngPixels, ASinkThatStopsIsNotCalledAgain) {
  const Sample made = large();
  for (const uint32_t threads : {1u, 3u}) {
    for (int taken = 0; taken < 8; ++taken) {
      int calls = 0;
      const absl::Status status =
          encode_png(made.view, {.threads = threads}, [&](const void*, size_t) { return ++calls <= taken; });
      EXPECT_EQ(status.message(), "cannot encode the PNG: write failed");
      EXPECT_EQ(calls, taken + 1);
    }
  }
}

TEST(PngPixels, ASinkWithoutMemoryEndsIt) {
  const Sample made = large();
  for (const uint32_t threads : {1u, 3u}) {
    for (int taken = 0; taken < 8; ++taken) {
      int calls = 0;
      const absl::Status status = encode_png(made.view, {.threads = threads}, [&](const void*, size_t) {
        return ++calls <= taken ? true : throw std::bad_alloc();
      });
      EXPECT_EQ(status.message(), "cannot encode the PNG: no memory");
    }
  }
}

TEST(PngPixels, APictureWithoutPixelsIsRefused) {
  const auto take = [](const void*, size_t) { return true; };
  for (const PictureView& view :
       {PictureView{.width = 0, .height = 3}, PictureView{.width = 3, .height = 0}}) {
    EXPECT_EQ(encode_png(view, {}, take).message(), "cannot encode the PNG: Invalid IHDR data");
  }
}

}  // namespace
}  // namespace candela
