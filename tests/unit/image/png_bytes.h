// PNG files of one row, with any chunks, without the code that the tests are about.
#pragma once

#include <gtest/gtest.h>
#include <zlib.h>

#include <string>

namespace candela {

inline std::string big_endian(uint32_t v) {
  return {static_cast<char>(v >> 24), static_cast<char>(v >> 16), static_cast<char>(v >> 8),
          static_cast<char>(v)};
}
inline std::string chunk(const std::string& name, const std::string& data) {
  const std::string all = name + data;
  const uLong crc = crc32(0, reinterpret_cast<const Bytef*>(all.data()), static_cast<uInt>(all.size()));
  return big_endian(static_cast<uint32_t>(data.size())) + all + big_endian(static_cast<uint32_t>(crc));
}
// A PNG of one row; `row` has its bytes.
inline std::string png_of(uint32_t width, int bits, int color_type, const std::string& row,
                          const std::string& chunks = "") {
  const std::string raw = std::string(1, '\0') + row;
  std::string packed(compressBound(raw.size()), '\0');
  uLongf size = packed.size();
  EXPECT_EQ(compress(reinterpret_cast<Bytef*>(packed.data()), &size,
                     reinterpret_cast<const Bytef*>(raw.data()), raw.size()),
            Z_OK);
  packed.resize(size);
  const std::string kind = {static_cast<char>(bits), static_cast<char>(color_type), 0, 0, 0};
  return "\x89PNG\r\n\x1a\n" + chunk("IHDR", big_endian(width) + big_endian(1) + kind) + chunks +
         chunk("IDAT", packed) + chunk("IEND", "");
}
inline std::string cicp(int primaries, int transfer, int matrix = 0, int full = 1) {
  return chunk("cICP", {static_cast<char>(primaries), static_cast<char>(transfer), static_cast<char>(matrix),
                        static_cast<char>(full)});
}

}  // namespace candela
