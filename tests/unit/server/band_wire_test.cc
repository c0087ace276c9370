// The hand-written band codec against the generated classes, which are the contract.
#include "proto/candela/v1/band_wire.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <optional>
#include <random>
#include <string>
#include <tuple>
#include <vector>

#include "candela/v1/render.pb.h"
#include "proto/candela/v1/limits.h"
#include "tests/support/status.h"

namespace candela::v1 {
namespace {

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

}  // namespace
}  // namespace candela::v1
