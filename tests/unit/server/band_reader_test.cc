#include "server/rpc/band_reader.h"

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "proto/candela/v1/band_wire.h"
#include "tests/support/clock/real_clock.h"
#include "tests/support/status.h"

namespace candela {
namespace {

// A frame of 3 x 5 RGB9E5 pixels with rows of 12 bytes, in memory as on a server.
class BandReaderTest : public ::testing::Test {
 protected:
  static constexpr FrameDesc kDesc{3, 5, v1::PIXEL_FORMAT_RGB9E5};
  static constexpr uint64_t kStride = 16;

  absl::Status read(uint32_t first_row, const std::string& pixels) {
    grpc::ByteBuffer message = v1::make_band(v1::kFrameBand, first_row, grpc::Slice(pixels));
    return reader_.read(message, [this](uint32_t y) {
      return std::span(reinterpret_cast<std::byte*>(rows_.at(y).data()), rows_.at(y).size());
    });
  }
  static std::string rows(int count, char fill = 'p') {
    std::string bytes;
    for (int i = 0; i < count; ++i) bytes += std::string(kDesc.row_bytes(), fill) + "padd";
    return bytes;
  }

  BandReader reader_{v1::kFrameBand, {kDesc, kDesc.format, kStride}, testing::real_clock()};
  std::vector<std::string> rows_ = std::vector<std::string>(5, std::string(12, '.'));
};

TEST_F(BandReaderTest, RowsGoToTheirPlacesWithoutTheirPadding) {
  ASSERT_OK(read(0, rows(2, 'a')));
  EXPECT_FALSE(reader_.check_complete().ok());
  ASSERT_OK(read(2, rows(3, 'b')));
  EXPECT_OK(reader_.check_complete());
  EXPECT_EQ(rows_[1], std::string(12, 'a'));
  EXPECT_EQ(rows_[2], std::string(12, 'b'));
  EXPECT_EQ(rows_[4], std::string(12, 'b'));
}

TEST_F(BandReaderTest, RefusesPartsOfRows) {
  EXPECT_TRUE(absl::IsInvalidArgument(read(0, rows(1) + "x")));
  EXPECT_TRUE(absl::IsInvalidArgument(read(0, std::string(12, 'x'))));  // a row without the padding
  EXPECT_EQ(rows_[0], std::string(12, '.'));
}

TEST_F(BandReaderTest, RefusesBandsOutOfOrderOverlappingOrWithAGap) {
  EXPECT_TRUE(absl::IsInvalidArgument(read(1, rows(1))));
  ASSERT_OK(read(0, rows(2)));
  EXPECT_TRUE(absl::IsInvalidArgument(read(1, rows(1))));
  EXPECT_TRUE(absl::IsInvalidArgument(read(3, rows(1))));
  EXPECT_TRUE(absl::IsInvalidArgument(read(0, rows(1))));
}

TEST_F(BandReaderTest, RefusesMoreRowsThanTheFrameHasWithoutWritingThem) {
  EXPECT_TRUE(absl::IsInvalidArgument(read(0, rows(6))));
  EXPECT_EQ(rows_[0], std::string(12, '.'));
  ASSERT_OK(read(0, rows(5)));
  EXPECT_TRUE(absl::IsInvalidArgument(read(5, rows(1))));
}

// Rows of two pixels of RGB16F, each with two bytes more.
TEST(BandReader, AddsAnAlphaToRowsWithoutOne) {
  const WireLayout layout{{2, 2, v1::PIXEL_FORMAT_RGBA16F}, v1::PIXEL_FORMAT_RGB16F, 14};
  BandReader reader(v1::kFrameBand, layout, testing::real_clock());
  std::string frame(2 * 16, '.');
  grpc::ByteBuffer message = v1::make_band(v1::kFrameBand, 0, grpc::Slice("abcdefghijkl--mnopqrstuvwx--"));
  ASSERT_OK(reader.read(message, [&frame](uint32_t y) {
    return std::span(reinterpret_cast<std::byte*>(&frame.at(y * 16)), 16);
  }));
  const std::string one("\x00\x3c", 2);
  const std::string whole = "abcdef" + one + "ghijkl" + one + "mnopqr" + one + "stuvwx" + one;
  EXPECT_EQ(frame, whole);
  // Compressed, without the bytes between rows.
  const std::string tight = "abcdefghijklmnopqrstuvwx";
  v1::RowPacker packer;
  message = v1::make_band(v1::kFrameBand, 0,
                          packer.pack(std::as_bytes(std::span(tight)), 2, v1::PIXEL_FORMAT_RGB16F),
                          v1::BandRows::kZstd);
  frame.assign(frame.size(), '.');
  BandReader unpacks(v1::kFrameBand, layout, testing::real_clock());
  ASSERT_OK(unpacks.read(message, [&frame](uint32_t y) {
    return std::span(reinterpret_cast<std::byte*>(&frame.at(y * 16)), 16);
  }));
  EXPECT_EQ(frame, whole);
}

TEST_F(BandReaderTest, RefusesABandWithoutPixels) { EXPECT_TRUE(absl::IsInvalidArgument(read(0, ""))); }

}  // namespace
}  // namespace candela
