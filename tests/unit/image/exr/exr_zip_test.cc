// ZIP and ZIPS scan lines, which candela decodes itself, against the same picture without compression, which
// OpenEXR decodes.
#include <OpenEXR/ImfThreading.h>
#include <gtest/gtest.h>
#include <hwy/highway.h>
#include <hwy/targets.h>
#include <zlib.h>

#include <cstring>
#include <random>

#include "absl/strings/str_cat.h"
#include "tests/support/status.h"
#include "tests/unit/image/exr/exr_reader_fixture.h"

namespace candela {
namespace {

using Imath::Box2i;
using Imath::V2i;

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
