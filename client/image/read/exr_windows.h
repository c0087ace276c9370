// OpenEXR's two windows. The display window is the picture. The data window is the area that the file stores,
// which may be smaller or larger.
#pragma once

#include <ImathBox.h>

#include <cstddef>
#include <cstdint>
#include <functional>

#include "client/image/image.h"

namespace candela {

// A rectangle in pixels, both ends included. 64 bits, so that no header causes an overflow.
struct Window {
  int64_t x0, y0, x1, y1;

  explicit Window(const Imath::Box2i& box) : x0(box.min.x), y0(box.min.y), x1(box.max.x), y1(box.max.y) {}
  int64_t width() const { return x1 - x0 + 1; }
  int64_t height() const { return y1 - y0 + 1; }
};

// Reads rows y0 to y1 of the data window. `origin` is the address that pixel (0, 0) of the file's coordinates
// would have. Throws like OpenEXR.
using ReadRows = std::function<void(char* origin, size_t row_bytes, int64_t y0, int64_t y1)>;

// Fills the part of `image` that `data` covers; `image` shows `display`. If rows of the data window fit into
// rows of the image, it reads them into place, otherwise through a band of rows. `grey` copies red to green
// and blue.
void read_windows(const Window& data, const Window& display, bool grey, const ReadRows& read_rows,
                  Image& image);

}  // namespace candela
