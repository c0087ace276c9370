// Bands as bytes, read and written, with and without zstd.
#include "proto/candela/v1/band_wire.h"

#include <gtest/gtest.h>
#include <zstd.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <optional>
#include <random>
#include <string>
#include <tuple>
#include <vector>

#include "candela/v1/render.pb.h"
#include "proto/candela/v1/limits.h"
#include "proto/candela/v1/pixel_size.h"
#include "server/rpc/band_reader.h"
#include "tests/support/clock.h"
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

namespace v1 {
namespace {

// The hand-written band codec against the generated classes, which are the contract.

std::string bytes_of(const grpc::ByteBuffer& buffer) {
  std::vector<grpc::Slice> slices;
  EXPECT_OK(buffer.Dump(&slices));
  std::string bytes;
  for (const grpc::Slice& slice : slices)
    bytes.append(reinterpret_cast<const char*>(slice.begin()), slice.size());
  return bytes;
}

// A message as gRPC delivers it, in slices of any size.
grpc::ByteBuffer buffer_of(const std::string& bytes, size_t slice_bytes) {
  std::vector<grpc::Slice> slices;
  for (size_t at = 0; at < bytes.size(); at += slice_bytes)
    slices.emplace_back(bytes.substr(at, slice_bytes));
  return grpc::ByteBuffer(slices.data(), slices.size());
}

struct Read {
  uint32_t first_row = 0;
  std::string pixels;
  std::string zstd = {};
};

absl::StatusOr<Read> read(const std::string& bytes, size_t slice_bytes = 7, BandKind kind = kFrameBand) {
  grpc::ByteBuffer buffer = buffer_of(bytes, slice_bytes);
  Read result;
  const absl::StatusOr<uint32_t> first_row = read_band(
      kind, buffer,
      [&](google::protobuf::io::CodedInputStream& input, uint64_t size, BandRows form) -> absl::Status {
        std::string rows;
        if (!input.ReadString(&rows, static_cast<int>(size))) return absl::DataLossError("short");
        result.pixels = form == BandRows::kPixels ? rows : "";
        result.zstd = form == BandRows::kZstd ? rows : "";
        return absl::OkStatus();
      });
  if (!first_row.ok()) return first_row.status();
  result.first_row = *first_row;
  return result;
}

std::string pattern(size_t size) {
  std::string bytes(size, '\0');
  for (size_t i = 0; i < size; ++i) bytes[i] = static_cast<char>(i * 131 + 7);
  return bytes;
}

RenderRequest request(uint32_t first_row, const std::string& pixels) {
  RenderRequest message;
  message.mutable_band()->set_first_row(first_row);
  message.mutable_band()->set_pixels(pixels);
  return message;
}

TEST(BandWire, BytesAreExactlyTheGeneratedClasses) {
  for (uint32_t first_row : {0u, 1u, 127u, 128u, 16383u, 0xffffffffu}) {
    for (size_t size : {size_t{1}, size_t{127}, size_t{128}, size_t{16384}, size_t{kMaxBandBytes}}) {
      const std::string pixels = pattern(size);
      RenderResponse response;
      response.mutable_band()->set_first_row(first_row);
      response.mutable_band()->set_pixels(pixels);
      const std::string ours = bytes_of(make_band(kImageBand, first_row, grpc::Slice(pixels)));
      EXPECT_EQ(ours, response.SerializeAsString()) << first_row << " " << size;
      EXPECT_EQ(ours, request(first_row, pixels).SerializeAsString());
    }
  }
}

TEST(BandWire, RowsAreOfOneForm) {
  RenderRequest plain = request(3, "abc"), packed;
  packed.mutable_band()->set_first_row(3);
  packed.mutable_band()->set_zstd("de");
  const std::string ours = bytes_of(make_band(kFrameBand, 3, grpc::Slice("de"), BandRows::kZstd));
  EXPECT_EQ(ours, packed.SerializeAsString());
  ASSERT_OK_AND_ASSIGN(const Read band, read(ours));
  EXPECT_EQ(band.zstd, "de");
  EXPECT_REFUSED(kInvalidArgument, "send one of them", read(plain.SerializeAsString() + ours));
  EXPECT_REFUSED(kInvalidArgument, "send one of them", read(ours + plain.SerializeAsString()));
  // Each would be work.
  EXPECT_REFUSED(kInvalidArgument, "zstd twice", read(ours + ours));
  RenderRequest start;
  start.mutable_start();
  EXPECT_REFUSED(kInvalidArgument, "zstd twice", read(ours + start.SerializeAsString() + ours));
  // An empty field is none.
  const std::string empty("\x12\x02\x12\x00", 4);
  EXPECT_EQ(read(ours + empty)->zstd, "de");
}

TEST(BandWire, TheErrorMapIsAnotherMemberOfTheSameMessage) {
  RenderResponse image, map;
  image.mutable_band()->set_pixels("abc");
  map.mutable_error_map()->set_first_row(7);
  map.mutable_error_map()->set_pixels("de");
  EXPECT_EQ(bytes_of(make_band(kErrorMapBand, 7, grpc::Slice("de"))), map.SerializeAsString());
  // In a oneof the last member counts.
  for (const auto& [first, second, kind, other] : {std::tuple(image, map, kErrorMapBand, kImageBand),
                                                   std::tuple(map, image, kImageBand, kErrorMapBand)}) {
    const std::string bytes = first.SerializeAsString() + second.SerializeAsString();
    ASSERT_OK_AND_ASSIGN(const Read band, read(bytes, 7, kind));
    EXPECT_EQ(band.pixels, second.has_band() ? "abc" : "de");
    EXPECT_TRUE(absl::IsInvalidArgument(read(bytes, 7, other).status()));
  }
  // In a request this field number is unknown.
  EXPECT_EQ(read(request(0, "abc").SerializeAsString() + map.SerializeAsString())->pixels, "abc");
}

TEST(BandWire, ReadsTheGeneratedClassesBytesInSlicesOfAnySize) {
  const std::string pixels = pattern(1000);
  for (size_t slice_bytes : {1, 2, 3, 64, 5000}) {
    ASSERT_OK_AND_ASSIGN(const Read band, read(request(300, pixels).SerializeAsString(), slice_bytes));
    EXPECT_EQ(band.first_row, 300u);
    EXPECT_EQ(band.pixels, pixels);
  }
}

TEST(BandWire, SkipsUnknownFieldsOfEveryWireType) {
  // Field 9: varint, fixed64, length-delimited, a group with a field inside, fixed32.
  const std::string unknown(
      "\x48\x96\x01\x49"
      "12345678"
      "\x4a\x03"
      "abc"
      "\x4b\x50\x01\x4c\x4d"
      "1234",
      26);
  const std::string band = unknown +
                           std::string(
                               "\x12\x02"
                               "hi",
                               4) +
                           unknown;
  std::string message = unknown + "\x12";
  message += static_cast<char>(band.size());
  message += band + unknown;
  RenderRequest generated;
  ASSERT_TRUE(generated.ParseFromString(message));
  ASSERT_EQ(generated.band().pixels(), "hi");
  ASSERT_OK_AND_ASSIGN(const Read ours, read(message));
  EXPECT_EQ(ours.pixels, "hi");
}

TEST(BandWire, FieldsMayComeInAnyOrderAndTheLastOneCounts) {
  // pixels "abc", first_row 5, pixels "de", first_row 6
  const std::string message(
      "\x12\x0d\x12\x03"
      "abc"
      "\x08\x05\x12\x02"
      "de"
      "\x08\x06",
      15);
  ASSERT_OK_AND_ASSIGN(const Read band, read(message));
  EXPECT_EQ(band.first_row, 6u);
  EXPECT_EQ(band.pixels, "de");
}

TEST(BandWire, AnEmptyLaterFieldOrPartEmptiesTheEarlierOne) {
  const std::string band = request(3, "abc").SerializeAsString();
  EXPECT_EQ(read(band + std::string("\x12\x02\x12\x00", 4))->pixels, "");
  ASSERT_OK_AND_ASSIGN(const Read replaced, read(band + std::string("\x0a\x00\x12\x00", 4)));
  EXPECT_EQ(replaced.pixels, "");
  EXPECT_EQ(replaced.first_row, 0u);
}

TEST(BandWire, RefusesAMessageWhoseLastPartIsNotABand) {
  RenderRequest start;
  start.mutable_start()->mutable_frame()->set_width(1);
  EXPECT_TRUE(absl::IsInvalidArgument(read(start.SerializeAsString()).status()));
  EXPECT_TRUE(absl::IsInvalidArgument(
      read(request(0, "abc").SerializeAsString() + start.SerializeAsString()).status()));
  EXPECT_TRUE(absl::IsInvalidArgument(read("").status()));
}

TEST(BandWire, RefusesABandOverTwoMebibytesBeforeItTakesAPixel) {
  const std::string message = request(0, pattern(kMaxBandBytes + 1)).SerializeAsString();
  grpc::ByteBuffer buffer = buffer_of(message, 1 << 16);
  bool taken = false;
  const absl::StatusOr<uint32_t> band =
      read_band(kFrameBand, buffer,
                [&](google::protobuf::io::CodedInputStream&, uint64_t bytes, BandRows) -> absl::Status {
                  taken |= bytes > 0;
                  return absl::OkStatus();
                });
  EXPECT_REFUSED(kInvalidArgument, "", band);
  EXPECT_FALSE(taken);
}

TEST(BandWire, EveryTruncationIsRefused) {
  const std::string message = request(300, pattern(200)).SerializeAsString();
  for (size_t size = 0; size < message.size(); ++size) {
    EXPECT_REFUSED(kInvalidArgument, "", read(message.substr(0, size))) << size;
  }
}

// For any bytes, it accepts what the generated class accepts and reads the same. It does not parse a
// RenderStart, so only messages without one are compared.
TEST(BandWire, AgreesWithTheGeneratedClassOnDamagedMessages) {
  std::mt19937 random(1);
  int accepted = 0;
  for (int i = 0; i < 50000; ++i) {
    std::string message = request(random() % 1000, pattern(1 + random() % 40)).SerializeAsString();
    if (random() % 4 == 0) message += request(random() % 3, pattern(1 + random() % 5)).SerializeAsString();
    for (int hits = 1 + static_cast<int>(random() % 3); hits > 0; --hits) {
      message[random() % std::min<size_t>(message.size(), 12)] = static_cast<char>(random());
    }
    const absl::StatusOr<Read> ours = read(message, 1 + random() % 9);
    RenderRequest generated;
    const bool parsed = generated.ParseFromString(message);
    const Band& band = generated.band();
    if (parsed && generated.has_band() && (band.pixels().empty() || band.zstd().empty())) {
      ASSERT_OK(ours) << generated.ShortDebugString();
      ASSERT_EQ(ours->first_row, generated.band().first_row());
      ASSERT_EQ(ours->pixels, generated.band().pixels());
      ASSERT_EQ(ours->zstd, generated.band().zstd());
      ++accepted;
    } else if (message.find('\x0a') == std::string::npos) {
      ASSERT_FALSE(ours.ok());
    }
  }
  EXPECT_GT(accepted, 1000);
}

constexpr std::array kFormats{PIXEL_FORMAT_RGBA16F, PIXEL_FORMAT_RGBA32F, PIXEL_FORMAT_RGB9E5,
                              PIXEL_FORMAT_RGB16F, PIXEL_FORMAT_RGB32F};

using Bytes = std::vector<std::byte>;

// Every pattern of bits may come: NaN, infinities, numbers below zero and subnormal ones among them.
Bytes noise(size_t size, uint32_t seed) {
  std::mt19937 random(seed);
  Bytes bytes(size);
  for (std::byte& byte : bytes) byte = static_cast<std::byte>(random());
  return bytes;
}

Bytes pack(const Bytes& rows, uint32_t width, PixelFormat format) {
  RowPacker packer;
  const grpc::Slice packed = packer.pack(rows, width, format);
  const auto* begin = reinterpret_cast<const std::byte*>(packed.begin());
  return {begin, begin + packed.size()};
}

absl::StatusOr<Bytes> unpack(const Bytes& packed, uint32_t width, PixelFormat format) {
  const absl::StatusOr<uint64_t> bytes = RowUnpacker::unpacked_bytes(packed);
  if (!bytes.ok()) return bytes.status();
  const uint64_t row = uint64_t{width} * bytes_per_pixel(format);
  RowUnpacker unpacker;
  if (const absl::Status status = unpacker.begin(packed, *bytes, width, format); !status.ok()) return status;
  Bytes rows(*bytes);
  for (uint32_t y = 0; y < *bytes / row; ++y) unpacker.read(y, std::span(rows).subspan(y * row, row));
  return rows;
}

TEST(ZstdRows, AreTheSameBitsForEveryFormatAndSize) {
  for (const PixelFormat format : kFormats) {
    for (const uint32_t width : {1u, 2u, 3u, 7u, 64u, 1001u}) {
      for (const uint32_t height : {1u, 2u, 5u}) {
        const Bytes rows = noise(size_t{width} * height * bytes_per_pixel(format), width + height);
        ASSERT_OK_AND_ASSIGN(const Bytes back, unpack(pack(rows, width, format), width, format));
        EXPECT_TRUE(back == rows) << format << " " << width << "x" << height;
      }
    }
  }
}

TEST(ZstdRows, ABandOfTheLargestSizeComesThrough) {
  const Bytes rows = noise(kMaxBandBytes, 1);
  ASSERT_OK_AND_ASSIGN(const Bytes back,
                       unpack(pack(rows, 8192, PIXEL_FORMAT_RGBA16F), 8192, PIXEL_FORMAT_RGBA16F));
  EXPECT_TRUE(back == rows);
}

TEST(ZstdRows, TakeLessForPixelsThatFollowEachOther) {
  constexpr uint32_t kWidth = 500;
  Bytes rows;
  for (uint32_t i = 0; i < 100 * kWidth; ++i) {
    // The bits of halves from 0.25 on, with a little noise, and an alpha of 1.
    const auto value = static_cast<uint16_t>(0x3400 + i % kWidth + i * 2654435761u % 8);
    for (const uint16_t component : {value, value, value, uint16_t{0x3c00}}) {
      const auto* bytes = reinterpret_cast<const std::byte*>(&component);
      rows.insert(rows.end(), bytes, bytes + 2);
    }
  }
  EXPECT_LT(pack(rows, kWidth, PIXEL_FORMAT_RGBA16F).size(), rows.size() / 3);
}

TEST(ZstdRows, WhatIsDamagedIsRefusedOrOtherPixels) {
  const Bytes rows = noise(7 * 3 * 8, 2);
  const Bytes packed = pack(rows, 7, PIXEL_FORMAT_RGBA16F);
  for (size_t length = 0; length < packed.size(); ++length) {
    const Bytes part(packed.begin(), packed.begin() + static_cast<ptrdiff_t>(length));
    EXPECT_TRUE(absl::IsInvalidArgument(unpack(part, 7, PIXEL_FORMAT_RGBA16F).status())) << length;
  }
  Bytes longer = packed;
  longer.insert(longer.end(), packed.begin(), packed.end());  // two frames of zstd
  EXPECT_TRUE(absl::IsInvalidArgument(unpack(longer, 7, PIXEL_FORMAT_RGBA16F).status()));
}

TEST(ZstdRows, AreRefusedByWhatTheySayOfTheirSize) {
  const auto refused = [](const Bytes& packed, const std::string& words) {
    EXPECT_REFUSED(kInvalidArgument, words, RowUnpacker::unpacked_bytes(packed).status());
  };
  refused({}, "not one whole frame of zstd");
  refused(noise(100, 3), "not one whole frame of zstd");
  // Two MiB of zeros and one byte more are a hundred bytes.
  const std::string zeros(kMaxBandBytes + 1, '\0');
  Bytes bomb(ZSTD_compressBound(zeros.size()));
  bomb.resize(ZSTD_compress(bomb.data(), bomb.size(), zeros.data(), zeros.size(), 1));
  EXPECT_LT(bomb.size(), 200u);
  refused(bomb, "holds 2097153 bytes and may hold at most 2097152");
  // In pieces, without its size.
  ZSTD_CCtx* context = ZSTD_createCCtx();
  Bytes streamed(1000);
  ZSTD_inBuffer in{zeros.data(), 100, 0};
  ZSTD_outBuffer out{streamed.data(), streamed.size(), 0};
  ZSTD_compressStream2(context, &out, &in, ZSTD_e_continue);
  while (ZSTD_compressStream2(context, &out, &in, ZSTD_e_end) != 0) continue;
  ZSTD_freeCCtx(context);
  streamed.resize(out.pos);
  refused(streamed, "does not say its size");
}

TEST(Alpha, IsOneInEveryFormatOfAnImage) {
  for (const auto& [format, one] : {std::pair(OUTPUT_FORMAT_RGBA8, std::string("\xff")),
                                    std::pair(OUTPUT_FORMAT_RGBA16, std::string("\xff\xff")),
                                    std::pair(OUTPUT_FORMAT_RGBA16F, std::string("\x00\x3c", 2))}) {
    const size_t pixel = bytes_per_pixel(format), rgb = pixel / 4 * 3;
    const Bytes narrow = noise(5 * rgb, 4);
    Bytes wide(5 * pixel), back(5 * rgb);
    add_alpha(format, narrow, wide);
    for (size_t x = 0; x < 5; ++x) EXPECT_EQ(std::memcmp(&wide[x * pixel + rgb], one.data(), one.size()), 0);
    leave_out_alpha(format, wide, back);
    EXPECT_TRUE(back == narrow);
  }
}

}  // namespace
}  // namespace v1
}  // namespace candela
