#include "client/image/read/exr/exr_windows.h"

#include <algorithm>
#include <new>

#include "absl/strings/str_cat.h"
#include "client/image/read/exr/zip/zip_rows.h"

namespace candela {
namespace {

template <typename T>
void spread(std::byte* row, int64_t pixels) {
  T* p = reinterpret_cast<T*>(row);
  for (int64_t i = 0; i < pixels; ++i, p += 4) p[1] = p[2] = p[0];
}

}  // namespace

char* origin_of(std::byte* first, size_t pixel_bytes, size_t row_bytes, int64_t x, int64_t y) {
  // Not pointer arithmetic, because the address is often outside the buffer.
  const auto offset = static_cast<uintptr_t>(x) * pixel_bytes + static_cast<uintptr_t>(y) * row_bytes;
  return reinterpret_cast<char*>(reinterpret_cast<uintptr_t>(first) - offset);
}

Imf::FrameBuffer frame_of(const ExrChannels& channels, ImageFormat format, char* origin, size_t row_bytes) {
  const Imf::PixelType type = format == ImageFormat::kRgba16f ? Imf::HALF : Imf::FLOAT;
  const size_t pixel_bytes = bytes_per_pixel(format);
  const std::string* const names[] = {&channels.red, &channels.green, &channels.blue, &channels.alpha};
  Imf::FrameBuffer frame;
  for (size_t c = 0; c < 4; ++c) {
    // OpenEXR fills a slice if the file lacks its channel, so this must be a name that no file uses.
    const std::string name = names[c]->empty() ? absl::StrCat("\x01", c) : *names[c];
    const double fill = c == 3 ? 1.0 : 0.0;
    frame.insert(name, Imf::Slice(type, origin + c * pixel_bytes / 4, pixel_bytes, row_bytes, 1, 1, fill));
  }
  return frame;
}

ReadRows rows_of(Imf::InputPart& input, const ExrChannels& channels, ImageFormat format, int threads) {
  if (has_zip_rows(input.header())) return zip_rows(input, channels, format, threads);
  return [&input, &channels, format](char* origin, size_t row_bytes, int64_t y0, int64_t y1) {
    input.setFrameBuffer(frame_of(channels, format, origin, row_bytes));
    input.readPixels(static_cast<int>(y0), static_cast<int>(y1));
  };
}

void spread_grey(ImageFormat format, std::byte* row, int64_t pixels) {
  if (format == ImageFormat::kRgba16f) {
    spread<uint16_t>(row, pixels);
  } else {
    spread<float>(row, pixels);
  }
}

void read_windows(const Window& data, const Window& display, bool grey, const ReadRows& read_rows,
                  Image& image) {
  const int64_t x0 = std::max(data.x0, display.x0), x1 = std::min(data.x1, display.x1);
  const int64_t y0 = std::max(data.y0, display.y0), y1 = std::min(data.y1, display.y1);
  const bool overlap = x0 <= x1 && y0 <= y1;
  const size_t pixel_bytes = bytes_per_pixel(image.format);
  const size_t row_bytes = image.row_bytes();
  const auto at = [&](int64_t x, int64_t y) {
    return image.pixels.data() + (y - display.y0) * row_bytes + (x - display.x0) * pixel_bytes;
  };
  if (overlap && data.x0 >= display.x0 && data.x1 <= display.x1) {
    read_rows(origin_of(image.pixels.data(), pixel_bytes, row_bytes, display.x0, display.y0), row_bytes, y0,
              y1);
  } else {
    // If the windows do not meet there is nothing to copy, but the rows are still read to find damage.
    const int64_t from = overlap ? y0 : data.y0, to = overlap ? y1 : data.y1;
    constexpr int64_t kBandRows = 256;  // a multiple of the chunk height of every compression
    const size_t band_row_bytes = static_cast<size_t>(data.width()) * pixel_bytes;
    PixelBuffer band(band_row_bytes * static_cast<size_t>(std::min(kBandRows, data.height())));
    if (band.empty()) throw std::bad_alloc();
    for (int64_t top = data.y0; top <= to; top += kBandRows) {
      const int64_t first = std::max(top, from), last = std::min(top + kBandRows - 1, to);
      if (first > last) continue;
      read_rows(origin_of(band.data(), pixel_bytes, band_row_bytes, data.x0, top), band_row_bytes, first,
                last);
      for (int64_t y = first; overlap && y <= last; ++y) {
        const std::byte* row = band.data() + (y - top) * band_row_bytes + (x0 - data.x0) * pixel_bytes;
        std::copy_n(row, (x1 - x0 + 1) * pixel_bytes, at(x0, y));
      }
    }
  }
  for (int64_t y = y0; grey && overlap && y <= y1; ++y) {
    spread_grey(image.format, at(x0, y), x1 - x0 + 1);
  }
}

}  // namespace candela
