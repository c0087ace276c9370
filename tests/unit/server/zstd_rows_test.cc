#include <gtest/gtest.h>
#include <zstd.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <random>
#include <string>

#include "proto/candela/v1/band_wire.h"
#include "proto/candela/v1/limits.h"
#include "proto/candela/v1/pixel_size.h"
#include "tests/support/status.h"

namespace candela::v1 {
namespace {

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
}  // namespace candela::v1
