// Reads a PNG and what it says of itself, without the code that the tests are about.
#pragma once

#include <gtest/gtest.h>
#include <png.h>
#include <zlib.h>

#include <cstdio>
#include <string>
#include <vector>

namespace candela {

struct Png {
  uint32_t width = 0, height = 0;
  int depth = 0, channels = 0, srgb = 0;
  double gamma = 0, red_x = 0;
  uint32_t density_x = 0, density_y = 0;
  std::vector<uint8_t> rows;  // 16 bit: big endian

  int code(uint32_t x, uint32_t y, int c) const {
    const size_t i = (size_t{y} * width + x) * channels + c;
    return depth == 8 ? rows[i] : rows[2 * i] * 256 + rows[2 * i + 1];
  }
};

inline Png read_png(const std::string& path) {
  Png out;
  std::FILE* file = std::fopen(path.c_str(), "rb");
  png_structp png = png_create_read_struct(PNG_LIBPNG_VER_STRING, nullptr, nullptr, nullptr);
  png_infop info = png_create_info_struct(png);
  png_init_io(png, file);
  png_read_info(png, info);
  out.width = png_get_image_width(png, info);
  out.height = png_get_image_height(png, info);
  out.depth = png_get_bit_depth(png, info);
  out.channels = png_get_channels(png, info);
  int intent = 0, unit = 0;
  out.srgb = png_get_sRGB(png, info, &intent) != 0;
  png_get_gAMA(png, info, &out.gamma);
  double ignored = 0;
  png_get_cHRM(png, info, &ignored, &ignored, &out.red_x, &ignored, &ignored, &ignored, &ignored, &ignored);
  png_get_pHYs(png, info, &out.density_x, &out.density_y, &unit);
  const size_t row_bytes = png_get_rowbytes(png, info);
  out.rows.resize(row_bytes * out.height);
  for (uint32_t y = 0; y < out.height; ++y) png_read_row(png, &out.rows[y * row_bytes], nullptr);
  png_read_end(png, info);
  png_destroy_read_struct(&png, &info, nullptr);
  std::fclose(file);
  return out;
}

// PNG files of one row, with any chunks, without the code that the tests are about.

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
