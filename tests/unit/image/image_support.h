// Helpers for the tests of client/image: pixels as floats, and OpenEXR files of every kind.
#pragma once

#include <OpenEXR/ImfFrameBuffer.h>
#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfPixelType.h>

#include <functional>
#include <string>
#include <vector>

#include "client/image/image.h"

namespace candela {

// Component `c` of a pixel as a float. Integer formats give their codes.
float component(const Image& image, uint32_t x, uint32_t y, int c);
bool same_pixels(const Image& a, const Image& b);  // bit for bit

// A channel of an OpenEXR file to write, with a value for every pixel of the data window.
struct ExrChannel {
  std::string name;
  Imf::PixelType type;
  std::function<double(int x, int y)> value;
};

// The frame buffer of `channels` over the header's data window, for level (0, 0), and its memory. The
// constructor also declares the channels in the header.
class ExrPixels {
 public:
  ExrPixels(Imf::Header& header, const std::vector<ExrChannel>& channels);
  const Imf::FrameBuffer& frame() const { return frame_; }

 private:
  std::vector<std::vector<char>> memory_;
  Imf::FrameBuffer frame_;
};

void write_scan_lines(const std::string& path, Imf::Header header, const std::vector<ExrChannel>& channels);

// Fills all levels but the largest with `wrong`, so that a test notices a reader that uses them.
void write_tiles(const std::string& path, Imf::Header header, const Imf::TileDescription& tiles,
                 const std::vector<ExrChannel>& channels, double wrong);

// A deep file of 4 x 4 pixels without samples.
void write_deep(const std::string& path);

// R, G and B with whole numbers that are exact as halves within a few hundred pixels of the origin.
std::vector<ExrChannel> rgb_channels(Imf::PixelType type = Imf::HALF, const std::string& prefix = "");
double rgb_value(int x, int y, int c);

}  // namespace candela
