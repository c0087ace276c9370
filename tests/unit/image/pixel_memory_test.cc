// Memory for pixels is kept and used again, within its limits, and shows nobody the pixels of before.
#include "server/base/pixel_memory.h"

#include <OpenEXR/ImfThreading.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>
#include <vector>

#include "tests/support/status.h"
#include "tests/unit/image/exr_reader_fixture.h"

namespace candela {
namespace {

constexpr size_t kMega = size_t{1} << 20;

TEST(PixelMemory, BeginsWithALargePage) {
  for (const size_t bytes : {kMega, 2 * kMega, 5 * kMega + 1}) {
    const PixelMemory pixels = new_pixels(bytes);
    EXPECT_EQ(reinterpret_cast<uintptr_t>(pixels.get()) % (2 * kMega), 0u);
    EXPECT_EQ(std::count(pixels.get(), pixels.get() + bytes, std::byte{0}), static_cast<ptrdiff_t>(bytes));
  }
  EXPECT_EQ(new_pixels(~size_t{0}), nullptr);
  EXPECT_EQ(pixels_to_overwrite(~size_t{0} / 2), nullptr);
  EXPECT_EQ(pixels_to_overwrite(size_t{1} << 60), nullptr);
}

TEST(PixelMemory, IsUsedAgain) {
  PixelMemory pixels = pixels_to_overwrite(5 * kMega);
  const std::byte* const place = pixels.get();
  std::memset(pixels.get(), 0xab, 5 * kMega);
  pixels.reset();
  EXPECT_GE(idle_pixels(), 5 * kMega);
  EXPECT_EQ(pixels_to_overwrite(5 * kMega).get(), place);
  EXPECT_EQ(pixels_to_overwrite(3 * kMega).get(), place);
  // Zeros are never memory of before.
  const PixelMemory zeros = new_pixels(5 * kMega);
  EXPECT_NE(zeros.get(), place);
  EXPECT_EQ(std::count(zeros.get(), zeros.get() + 5 * kMega, std::byte{0}),
            static_cast<ptrdiff_t>(5 * kMega));
  EXPECT_NE(pixels_to_overwrite(20 * kMega).get(), place);
}

TEST(PixelMemory, IsKeptWithinTheMostThatWasInUse) {
  PixelMemory small = pixels_to_overwrite(5 * kMega);
  const std::byte* const place = small.get();
  small.reset();
  EXPECT_EQ(pixels_to_overwrite(5 * kMega).get(), place);
  ASSERT_GT(idle_pixels(), 0u);
  // Far more than anything else that this process uses, but not written.
  PixelMemory large = new_pixels(512 * kMega);
  ASSERT_NE(large, nullptr);
  EXPECT_EQ(idle_pixels(), 0u);
  large.reset();
  EXPECT_EQ(idle_pixels(), 0u) << "it is more than kMostIdlePixels";
  std::vector<PixelMemory> many;
  for (int i = 0; i < 10; ++i) many.push_back(pixels_to_overwrite(50 * kMega));
  many.clear();
  EXPECT_GT(idle_pixels(), 150 * kMega);
  EXPECT_LE(idle_pixels(), kMostIdlePixels);
}

// Leaves memory of an image's size full of something.
void leave_old_pixels(const Image& image) {
  const PixelMemory old = pixels_to_overwrite(image.bytes());
  std::memset(old.get(), 0xab, image.bytes());
}

class OldPixels : public ExrReader {
 protected:
  ~OldPixels() override { Imf::setGlobalThreadCount(0); }

  void expect_none_shown(const PictureChoice& choice = {}) {
    ASSERT_OK_AND_ASSIGN(const Image first, read_image(path_, {}, choice));
    ASSERT_GE(first.bytes(), kMega);
    leave_old_pixels(first);
    ASSERT_OK_AND_ASSIGN(const Image again, read_image(path_, {}, choice));
    EXPECT_TRUE(same_pixels(again, first));
  }
};

TEST_F(OldPixels, AreNotShownByOpenExrFiles) {
  using Imath::Box2i, Imath::V2i;
  const Box2i display(V2i(0, 0), V2i(511, 319));
  for (const int threads : {0, 2}) {
    Imf::setGlobalThreadCount(threads);
    for (const Box2i& data : {display, Box2i(V2i(-9, -9), V2i(600, 400)), Box2i(V2i(3, 5), V2i(500, 310)),
                              Box2i(V2i(0, 5), V2i(511, 319)), Box2i(V2i(600, 0), V2i(700, 10))}) {
      for (const Imf::Compression compression :
           {Imf::ZIP_COMPRESSION, Imf::ZIPS_COMPRESSION, Imf::PIZ_COMPRESSION, Imf::NO_COMPRESSION}) {
        Imf::Header header(display, data);
        header.compression() = compression;
        write_scan_lines(path_, header, rgb_channels());
        expect_none_shown();
        expect_none_shown({.as_floats = true});
      }
    }
  }
}

TEST_F(OldPixels, AreNotShownWhereChunksAreMissing) {
  Imf::Header header(512, 320);
  header.compression() = Imf::ZIP_COMPRESSION;
  write_scan_lines(path_, header, rgb_channels());
  std::string bytes = read_file(path_);
  bytes[bytes.size() - 40] ^= 0x55;
  write_file(path_, bytes);
  EXPECT_FALSE(read_image(path_).ok());
  expect_none_shown({.fills_gaps = true});
}

TEST_F(OldPixels, AreNotShownByPfmFiles) {
  for (const char* kind : {"PF", "Pf", "PH"}) {
    const size_t row = 512 * (kind[1] == 'f' ? 4 : kind[1] == 'H' ? 6 : 12);
    const std::string header = std::string(kind) + "\n512 320\n-1\n";
    write_file(path_, header + std::string(320 * row, '\x11'));
    expect_none_shown();
    write_file(path_, header + std::string(300 * row, '\x11'));
    EXPECT_FALSE(read_image(path_).ok());
    expect_none_shown({.fills_gaps = true});
  }
}

}  // namespace
}  // namespace candela
