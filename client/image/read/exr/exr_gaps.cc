#include "client/image/read/exr/exr_gaps.h"

#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfInputPart.h>
#include <OpenEXR/ImfTiledInputPart.h>

#include <algorithm>
#include <functional>
#include <new>

#include "client/image/read/exr/exr_checks.h"
#include "client/image/read/exr/exr_windows.h"

namespace candela {
namespace {

Window overlap_of(const Window& a, const Window& b) {
  Window both = a;
  both.x0 = std::max(a.x0, b.x0), both.x1 = std::min(a.x1, b.x1);
  both.y0 = std::max(a.y0, b.y0), both.y1 = std::min(a.y1, b.y1);
  return both;
}

uint64_t pixels_in(const Window& window) {
  if (window.x1 < window.x0 || window.y1 < window.y0) return 0;
  return static_cast<uint64_t>(window.width()) * static_cast<uint64_t>(window.height());
}

class GapReader {
 public:
  GapReader(const Imf::Header& header, const ExrChannels& channels, Image* image)
      : channels_(channels),
        data_(header.dataWindow()),
        display_(header.displayWindow()),
        format_(exr_format(header, channels)),
        image_(image) {
    gaps_.pixels = pixels_in(overlap_of(data_, display_));
  }

  // Reads a chunk, which covers `box`: `read` writes it as ReadRows do.
  void read_chunk(const Window& box, const std::function<void(char* origin, size_t row_bytes)>& read) {
    const size_t pixel_bytes = bytes_per_pixel(format_);
    const size_t row_bytes = static_cast<size_t>(box.width()) * pixel_bytes;
    const size_t bytes = row_bytes * static_cast<size_t>(box.height());
    if (chunk_.size() < bytes) {
      chunk_ = PixelBuffer(bytes);
      if (chunk_.size() < bytes) throw std::bad_alloc();
    }
    const Window shown = overlap_of(box, display_);
    try {
      read(origin_of(chunk_.data(), pixel_bytes, row_bytes, box.x0, box.y0), row_bytes);
    } catch (const std::bad_alloc&) {
      throw;
    } catch (const std::exception&) {
      gaps_.missing += pixels_in(shown);
      return;
    }
    if (image_ == nullptr || pixels_in(shown) == 0) return;
    for (int64_t y = shown.y0; y <= shown.y1; ++y) {
      const std::byte* from = chunk_.data() + (y - box.y0) * row_bytes + (shown.x0 - box.x0) * pixel_bytes;
      std::byte* to = image_->pixels.data() + (y - display_.y0) * image_->row_bytes() +
                      (shown.x0 - display_.x0) * pixel_bytes;
      std::copy_n(from, static_cast<size_t>(shown.width()) * pixel_bytes, to);
      if (channels_.kind == ExrChannels::Kind::kGrey) spread_grey(format_, to, shown.width());
    }
  }

  const ExrChannels& channels() const { return channels_; }
  ImageFormat format() const { return format_; }
  const Window& data() const { return data_; }
  Gaps gaps() const { return gaps_; }

 private:
  const ExrChannels& channels_;
  const Window data_, display_;
  const ImageFormat format_;
  Image* const image_;
  PixelBuffer chunk_;
  Gaps gaps_;
};

void read_tiles(Imf::MultiPartInputFile& file, int part, GapReader& reader) {
  Imf::TiledInputPart input(file, part);
  for (int y = 0; y < input.numYTiles(); ++y) {
    for (int x = 0; x < input.numXTiles(); ++x) {
      reader.read_chunk(Window(input.dataWindowForTile(x, y)), [&](char* origin, size_t row_bytes) {
        input.setFrameBuffer(frame_of(reader.channels(), reader.format(), origin, row_bytes));
        input.readTile(x, y);
      });
    }
  }
}

void read_scan_lines(Imf::MultiPartInputFile& file, int part, GapReader& reader) {
  Imf::InputPart input(file, part);
  const Window& data = reader.data();
  const ReadRows read_rows = rows_of(input, reader.channels(), reader.format(), 0);
  const int64_t rows = rows_of_chunk(input.header().compression());
  for (int64_t y = data.y0; y <= data.y1; y += rows) {
    Window box = data;
    box.y0 = y;
    box.y1 = std::min(data.y1, y + rows - 1);
    reader.read_chunk(box,
                      [&](char* origin, size_t row_bytes) { read_rows(origin, row_bytes, box.y0, box.y1); });
  }
}

}  // namespace

Gaps read_with_gaps(Imf::MultiPartInputFile& file, int part, const ExrChannels& channels, Image* image) {
  const Imf::Header& header = file.header(part);
  GapReader reader(header, channels, image);
  if (header.hasTileDescription()) {
    read_tiles(file, part, reader);
  } else {
    read_scan_lines(file, part, reader);
  }
  Gaps gaps = reader.gaps();
  gaps.unfinished = !file.partComplete(part);
  return gaps;
}

}  // namespace candela
