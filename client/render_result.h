// What a rendered frame comes back as.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "candela/v1/render.pb.h"

namespace candela {

// A rendered image and what the server says about it. Movable.
struct RenderResult {
  v1::ResultHeader header;
  // header.height rows of header.width pixels of header.format, tight; where header.encoded_bytes is above 0,
  // a PNG or JPEG file of so many bytes.
  std::unique_ptr<std::byte[]> data;
  size_t bytes = 0;
  // Where it was asked for: a half a pixel, rows from top to bottom, the largest error of R, G and B in
  // codes.
  std::vector<uint16_t> error_map;

  std::span<const std::byte> pixels() const { return {data.get(), bytes}; }
};

}  // namespace candela
