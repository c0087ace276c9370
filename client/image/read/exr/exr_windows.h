// OpenEXR's two windows. The display window is the picture. The data window is the area that the file stores,
// which may be smaller or larger.
#pragma once

#include <ImathBox.h>
#include <OpenEXR/ImfFrameBuffer.h>
#include <OpenEXR/ImfInputPart.h>

#include <cstddef>
#include <cstdint>
#include <functional>

#include "client/image/image.h"
#include "client/image/read/exr/exr_channels.h"

namespace candela {

// A rectangle in pixels, both ends included. 64 bits, so that no header causes an overflow.
struct Window {
  int64_t x0, y0, x1, y1;

  explicit Window(const Imath::Box2i& box) : x0(box.min.x), y0(box.min.y), x1(box.max.x), y1(box.max.y) {}
  int64_t width() const { return x1 - x0 + 1; }
  int64_t height() const { return y1 - y0 + 1; }
};

// The address that pixel (0, 0) of the file's coordinates would have if (x, y) is at `first`.
char* origin_of(std::byte* first, size_t pixel_bytes, size_t row_bytes, int64_t x, int64_t y);

// Where OpenEXR writes the channels of a picture that is not luminance-chroma. A channel that the file lacks
// reads as 0, and alpha as 1.
Imf::FrameBuffer frame_of(const ExrChannels& channels, ImageFormat format, char* origin, size_t row_bytes);

// Copies red to green and blue.
void spread_grey(ImageFormat format, std::byte* row, int64_t pixels);

// Reads rows y0 to y1 of the data window. `origin` is the address that pixel (0, 0) of the file's coordinates
// would have. Throws like OpenEXR.
using ReadRows = std::function<void(char* origin, size_t row_bytes, int64_t y0, int64_t y1)>;

// Reads a part that is not luminance-chroma. A channel that the file lacks reads as 0, and alpha as 1.
// `input` and `channels` must outlive what this returns. `threads` are for zip/zip_rows.h; for what OpenEXR
// decodes they are those that the file was opened with.
ReadRows rows_of(Imf::InputPart& input, const ExrChannels& channels, ImageFormat format, int threads);

// Fills the part of `image` that `data` covers; `image` shows `display`. If rows of the data window fit into
// rows of the image, it reads them into place, otherwise through a band of rows. `grey` copies red to green
// and blue.
void read_windows(const Window& data, const Window& display, bool grey, const ReadRows& read_rows,
                  Image& image);

}  // namespace candela
