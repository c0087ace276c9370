// The result of rendering a frame.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "candela/v1/render.pb.h"
#include "server/base/pixel_memory.h"

namespace candela {

// A rendered image with the server's header. Movable.
struct RenderResult {
  v1::ResultHeader header;  // size, format, exposure, statistics and times
  // header.height rows of header.width pixels in header.format, from top to bottom without padding. If
  // header.encoded_bytes is above 0, a PNG or JPEG file instead.
  PixelMemory data;
  size_t bytes = 0;  // size of `data`
  // The error map, if the request asked for one: one half per pixel, rows from top to bottom, the largest
  // error of R, G and B in codes.
  std::vector<uint16_t> error_map;

  std::span<const std::byte> pixels() const { return {data.get(), bytes}; }
};

}  // namespace candela
