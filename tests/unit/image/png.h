// Reads a PNG and what it says of itself, without the code that the tests are about.
#pragma once

#include <png.h>

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

}  // namespace candela
