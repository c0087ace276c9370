// Images for the tests of the command: one to render, and the header of a PNG.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace candela {

// A PNG's header; all zeros if the file is not a PNG.
struct PngFacts {
  uint32_t width = 0;
  uint32_t height = 0;
  int bits = 0;
  bool alpha = false;
  double pixel_aspect = 1;  // width / height of a pixel, from pHYs
};
PngFacts png_facts(const std::string& path);

// R, G and B of a PFM file's pixels, the lowest row first. Fails the test if it is none of colours.
std::vector<float> pfm_values(const std::string& path);

// Writes an OpenEXR file of 31 x 17 halves with highlights, optionally with alpha and wide pixels.
void write_small_exr(const std::string& path, bool alpha_and_aspect = false);

}  // namespace candela
