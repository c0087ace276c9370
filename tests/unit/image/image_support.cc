#include "tests/unit/image/image_support.h"

#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfDeepFrameBuffer.h>
#include <OpenEXR/ImfDeepScanLineOutputFile.h>
#include <OpenEXR/ImfOutputFile.h>
#include <OpenEXR/ImfPartType.h>
#include <OpenEXR/ImfTileDescription.h>
#include <OpenEXR/ImfTiledOutputFile.h>
#include <half.h>

#include <cstring>

namespace candela {

float component(const Image& image, uint32_t x, uint32_t y, int c) {
  const size_t size = bytes_per_pixel(image.format) / 4;
  const std::byte* at = image.pixels.data() + y * image.row_bytes() + (size_t{4} * x + c) * size;
  uint16_t half = 0;
  float value = 0;
  switch (image.format) {
    case ImageFormat::kRgba8:
      return static_cast<float>(*at);
    case ImageFormat::kRgba32f:
      std::memcpy(&value, at, sizeof value);
      return value;
    case ImageFormat::kRgba16f:
    case ImageFormat::kRgba16:
      std::memcpy(&half, at, sizeof half);
      return image.format == ImageFormat::kRgba16 ? half : imath_half_to_float(half);
  }
  return value;
}

bool same_pixels(const Image& a, const Image& b) {
  return a.width == b.width && a.height == b.height && a.format == b.format &&
         a.pixels.size() == b.pixels.size() &&
         std::memcmp(a.pixels.data(), b.pixels.data(), a.pixels.size()) == 0;
}

ExrPixels::ExrPixels(Imf::Header& header, const std::vector<ExrChannel>& channels) {
  const Imath::Box2i window = header.dataWindow();
  const size_t width = static_cast<size_t>(window.max.x - window.min.x + 1);
  const size_t height = static_cast<size_t>(window.max.y - window.min.y + 1);
  for (const ExrChannel& channel : channels) {
    header.channels().insert(channel.name, Imf::Channel(channel.type));
    const size_t size = channel.type == Imf::HALF ? 2 : 4;
    std::vector<char>& bytes = memory_.emplace_back(width * height * size);
    char* at = bytes.data();
    for (int y = window.min.y; y <= window.max.y; ++y) {
      for (int x = window.min.x; x <= window.max.x; ++x, at += size) {
        const double value = channel.value(x, y);
        const auto as_float = static_cast<float>(value);
        const half as_half(channel.type == Imf::HALF ? as_float : 0.0f);
        const uint32_t as_uint = channel.type == Imf::UINT ? static_cast<uint32_t>(value) : 0;
        const void* from = channel.type == Imf::HALF    ? static_cast<const void*>(&as_half)
                           : channel.type == Imf::FLOAT ? static_cast<const void*>(&as_float)
                                                        : static_cast<const void*>(&as_uint);
        std::memcpy(at, from, size);
      }
    }
    frame_.insert(channel.name, Imf::Slice::Make(channel.type, bytes.data(), window));
  }
}

void write_scan_lines(const std::string& path, Imf::Header header, const std::vector<ExrChannel>& channels) {
  const ExrPixels pixels(header, channels);
  Imf::OutputFile file(path.c_str(), header);
  file.setFrameBuffer(pixels.frame());
  const Imath::Box2i window = header.dataWindow();
  file.writePixels(window.max.y - window.min.y + 1);
}

void write_tiles(const std::string& path, Imf::Header header, const Imf::TileDescription& tiles,
                 const std::vector<ExrChannel>& channels, double wrong) {
  std::vector<ExrChannel> smaller = channels;
  for (ExrChannel& channel : smaller) channel.value = [wrong](int, int) { return wrong; };
  const ExrPixels pixels(header, channels), decoys(header, smaller);
  header.setTileDescription(tiles);
  Imf::TiledOutputFile file(path.c_str(), header);
  for (int ly = 0; ly < file.numYLevels(); ++ly) {
    for (int lx = 0; lx < file.numXLevels(); ++lx) {
      if (!file.isValidLevel(lx, ly)) continue;
      file.setFrameBuffer(lx == 0 && ly == 0 ? pixels.frame() : decoys.frame());
      file.writeTiles(0, file.numXTiles(lx) - 1, 0, file.numYTiles(ly) - 1, lx, ly);
    }
  }
}

void write_deep(const std::string& path) {
  Imf::Header header(4, 4);
  header.channels().insert("R", Imf::Channel(Imf::HALF));
  header.setType(Imf::DEEPSCANLINE);
  header.compression() = Imf::ZIPS_COMPRESSION;
  std::vector<unsigned> counts(16, 0);
  std::vector<void*> samples(16, nullptr);
  Imf::DeepFrameBuffer frame;
  frame.insertSampleCountSlice(Imf::Slice::Make(Imf::UINT, counts.data(), header.dataWindow()));
  frame.insert("R", Imf::DeepSlice(Imf::HALF, reinterpret_cast<char*>(samples.data()), sizeof(void*),
                                   sizeof(void*) * 4, sizeof(uint16_t)));
  Imf::DeepScanLineOutputFile file(path.c_str(), header);
  file.setFrameBuffer(frame);
  file.writePixels(4);
}

double rgb_value(int x, int y, int c) { return (c - 1) * 100 + x + 2 * y; }

std::vector<ExrChannel> rgb_channels(Imf::PixelType type, const std::string& prefix) {
  std::vector<ExrChannel> channels;
  for (int c = 0; c < 3; ++c) {
    channels.push_back({prefix + "RGB"[c], type, [c](int x, int y) { return rgb_value(x, y, c); }});
  }
  return channels;
}

}  // namespace candela
