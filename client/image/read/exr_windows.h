// OpenEXR's two windows: the display window is the picture, the data window is the part of it (or beyond it)
// that the file stores.
#pragma once

#include <ImathBox.h>

#include <cstddef>
#include <cstdint>
#include <functional>

#include "client/image/image.h"

namespace candela {

// In pixels, both ends within; 64-bit so that no header overflows it.
struct Window {
  int64_t x0, y0, x1, y1;

  explicit Window(const Imath::Box2i& box) : x0(box.min.x), y0(box.min.y), x1(box.max.x), y1(box.max.y) {}
  int64_t width() const { return x1 - x0 + 1; }
  int64_t height() const { return y1 - y0 + 1; }
};

// Reads rows y0..y1 of the data window; `origin` is where pixel (0, 0) of the file's coordinates would lie.
// Throws as OpenEXR does.
using ReadRows = std::function<void(char* origin, size_t row_bytes, int64_t y0, int64_t y1)>;

// Fills the part of `image`, which shows `display`, that `data` covers: straight into the image where rows of
// the data window fit its rows, else through a band of rows. `grey` spreads red over green and blue.
void read_windows(const Window& data, const Window& display, bool grey, const ReadRows& read_rows,
                  Image& image);

}  // namespace candela
