// What tests of images share: files to read, and signals in them.
#pragma once

#include <OpenEXR/ImfFrameBuffer.h>
#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfPixelType.h>
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <functional>
#include <string>
#include <vector>

#include "client/image/image.h"
#include "client/image/read/signal.h"
#include "tests/support/status.h"

namespace candela {

// Helpers for the tests of client/image: pixels as floats, and OpenEXR files of every kind.

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

// Helpers for the tests of files that hold a signal.

inline uint16_t code_of(double signal) { return static_cast<uint16_t>(std::lround(signal * 65535)); }

// The light of a signal, in nit of reference white 203, for R, G, B.
inline std::array<double, 3> nits(const Signal& signal, std::array<double, 3> v,
                                  const PictureChoice& choice = {}) {
  const std::array<uint16_t, 4> codes = {code_of(v[0]), code_of(v[1]), code_of(v[2]), 65535};
  float light[4];
  SignalDecoder(signal, choice).decode(codes, light);
  return {light[0] * 203.0, light[1] * 203.0, light[2] * 203.0};
}

inline Signal of_code_points(int primaries, int transfer) {
  Signal signal;
  EXPECT_OK(set_code_points("file", "nclx", primaries, transfer, {}, signal));
  return signal;
}

inline absl::StatusOr<Image> read_signal(const std::string& bytes, const PictureChoice& choice = {}) {
  return read_image_bytes("file", bytes, {}, choice);
}

inline float light_at(const Image& image, uint32_t x, size_t component) {
  float v;
  std::memcpy(&v, image.pixels.data() + x * 16 + component * 4, sizeof v);
  return v;
}

}  // namespace candela
