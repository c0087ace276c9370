// Images for the tests of the command: one to render, and what a PNG says of itself.
#pragma once

#include <cstdint>
#include <string>

namespace candela {

// What a PNG's header says; all zero when the file is none.
struct PngFacts {
  uint32_t width = 0;
  uint32_t height = 0;
  int bits = 0;
  bool alpha = false;
  double pixel_aspect = 1;  // width / height of a pixel, from pHYs
};
PngFacts png_facts(const std::string& path);

// An OpenEXR file of 31 x 17 halves with highlights; with alpha and pixels twice as wide as high on request.
void write_small_exr(const std::string& path, bool alpha_and_aspect = false);

}  // namespace candela
