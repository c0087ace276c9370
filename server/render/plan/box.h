// A rectangle of texels, tiles or work groups.
#pragma once

#include <cstdint>

namespace candela {

// Columns x0 to x1 - 1 of rows y0 to y1 - 1.
struct Box {
  uint32_t x0 = 0;
  uint32_t y0 = 0;
  uint32_t x1 = 0;
  uint32_t y1 = 0;
  bool operator==(const Box&) const = default;
};

}  // namespace candela
