// JPEG files for tests: plain ones, and those with a gain map.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "client/image/image.h"
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

inline absl::StatusOr<Image> read_jpeg_bytes(const std::string& bytes, const PictureChoice& choice = {},
                                             const ImageLimits& limits = {}) {
  return read_image_bytes("file", bytes, limits, choice);
}

inline CodeAt flat(int code) {
  return [code](uint32_t, uint32_t, int) { return code; };
}

inline bool has_note(const Image& image, const std::string& words) {
  return std::ranges::any_of(image.notes,
                             [&](const std::string& note) { return note.find(words) != note.npos; });
}

// Puts segments behind the start of a file.
inline std::string with(const std::string& file, const std::string& segments) {
  return file.substr(0, 2) + segments + file.substr(2);
}

// The file with every `from` replaced by `to`, which is as long; or only the one number `which`, from 0.
inline std::string renamed(std::string file, const std::string& from, const std::string& to, int which = -1) {
  EXPECT_EQ(from.size(), to.size());
  int count = 0;
  for (size_t at = 0; (at = file.find(from, at)) != file.npos; at += from.size()) {
    if (which < 0 || which == count) file.replace(at, to.size(), to);
    ++count;
  }
  EXPECT_GT(count, std::max(which, 0)) << from;
  return file;
}

inline const std::string kIsoGainMap = "urn:iso:std:iso:ts:21496:-1";

// The file with the map's ISO metadata replaced, from its first byte.
inline std::string with_iso(std::string file, const std::string& bytes) {
  const size_t at = file.rfind(kIsoGainMap) + kIsoGainMap.size() + 1;
  return file.replace(at, bytes.size(), bytes);
}

inline GainMapMetadata three_channels() {
  return {.min_log2 = {-1, -0.5, 0},
          .max_log2 = {2, 3, 4},
          .gamma = {1, 0.5, 2},
          .offset_sdr = {1.0 / 64, 1.0 / 32, 1.0 / 16},
          .offset_hdr = {1.0 / 32, 1.0 / 64, 1.0 / 128},
          .headroom_hdr_log2 = 3.2,
          .one_channel = false};
}

}  // namespace candela
