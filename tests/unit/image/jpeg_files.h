// JPEG files for tests: plain ones, and those with a gain map.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "server/encode/gain_map.h"
#include "server/encode/picture.h"
#include "tests/support/status.h"

namespace candela {

using CodeAt = std::function<int(uint32_t x, uint32_t y, int channel)>;

// The picture of these codes, of the best quality.
inline std::string jpeg_of(uint32_t width, uint32_t height, const CodeAt& code,
                           const JpegOptions& options = {100}) {
  std::vector<std::byte> rows(size_t{4} * width * height, std::byte{255});
  for (size_t i = 0; i < rows.size(); ++i) {
    const size_t pixel = i / 4;
    if (i % 4 == 3) continue;
    rows[i] = static_cast<std::byte>(code(static_cast<uint32_t>(pixel % width),
                                          static_cast<uint32_t>(pixel / width), static_cast<int>(i % 4)));
  }
  std::string file;
  EXPECT_OK(encode_jpeg(
      {.width = width, .height = height, .rows = rows.data(), .row_stride_bytes = size_t{4} * width}, options,
      [&file](const void* bytes, size_t count) {
        file.append(static_cast<const char*>(bytes), count);
        return true;
      }));
  return file;
}

// The map of these codes.
inline std::string map_of(uint32_t width, uint32_t height, bool one_channel, const CodeAt& code) {
  std::vector<uint8_t> codes;
  for (uint32_t y = 0; y < height; ++y) {
    for (uint32_t x = 0; x < width; ++x) {
      for (int c = 0; c < (one_channel ? 1 : 3); ++c) codes.push_back(static_cast<uint8_t>(code(x, y, c)));
    }
  }
  const absl::StatusOr<std::string> file = encode_gain_map(codes, width, height, one_channel, 100);
  EXPECT_OK(file.status());
  return file.value_or("");
}

inline std::string joined(const std::string& base, const std::string& map, const GainMapMetadata& metadata) {
  const absl::StatusOr<std::string> file = join_gain_map(base, map, metadata);
  EXPECT_OK(file.status());
  return file.value_or("");
}

// Gains of 0 .. `stops`, of one channel.
inline GainMapMetadata stops_of(double stops) {
  return {.max_log2 = {stops, stops, stops}, .headroom_hdr_log2 = stops};
}

// A segment of a JPEG file, with its marker and length.
inline std::string jpeg_segment(int marker, const std::string& body) {
  const size_t length = body.size() + 2;
  return std::string{'\xff', static_cast<char>(marker), static_cast<char>(length >> 8),
                     static_cast<char>(length)} +
         body;
}

}  // namespace candela
