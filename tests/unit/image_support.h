// What the tests of client/image share: pixels as floats, OpenEXR files of every kind.
#pragma once

#include <OpenEXR/ImfFrameBuffer.h>
#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfPixelType.h>

#include <functional>
#include <string>
#include <vector>

#include "client/image/image.h"

namespace candela {

// Component `c` of a pixel as a float; integer formats as their codes.
float component(const Image& image, uint32_t x, uint32_t y, int c);
bool same_pixels(const Image& a, const Image& b);  // bit for bit

// One channel of an OpenEXR file to be made: a value for every pixel of the data window.
struct ExrChannel {
  std::string name;
  Imf::PixelType type;
  std::function<double(int x, int y)> value;
};

// The memory behind a frame buffer that holds `channels` over the header's data window; also declares them in
// the header. Level (0, 0) only.
class ExrPixels {
 public:
  ExrPixels(Imf::Header& header, const std::vector<ExrChannel>& channels);
  const Imf::FrameBuffer& frame() const { return frame_; }

 private:
  std::vector<std::vector<char>> memory_;
  Imf::FrameBuffer frame_;
};

void write_scan_lines(const std::string& path, Imf::Header header, const std::vector<ExrChannel>& channels);

// Levels above the largest are filled with `wrong` so that a reader that takes them is found out.
void write_tiles(const std::string& path, Imf::Header header, const Imf::TileDescription& tiles,
                 const std::vector<ExrChannel>& channels, double wrong);

// R, G, B: whole numbers that halves hold exactly within a few hundred pixels of the origin.
std::vector<ExrChannel> rgb_channels(Imf::PixelType type = Imf::HALF, const std::string& prefix = "");
double rgb_value(int x, int y, int c);

}  // namespace candela
