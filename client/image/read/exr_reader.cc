// Reads OpenEXR files.
//
// Choices: the display window is the picture, and its pixels outside the data window are 0 with alpha 0. Of
// several parts the first with colour is used, of several levels the largest. Unsigned integers are plain
// values. Deep images are refused. Luminance-chroma files go through OpenEXR's own RGBA interface, which has
// the chroma filters and weighs Y by the file's chromaticities.
#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfChromaticitiesAttribute.h>
#include <OpenEXR/ImfFrameBuffer.h>
#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfInputPart.h>
#include <OpenEXR/ImfMultiPartInputFile.h>
#include <OpenEXR/ImfPartType.h>
#include <OpenEXR/ImfRgbaFile.h>
#include <OpenEXR/ImfStandardAttributes.h>

#include <algorithm>
#include <exception>
#include <new>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_replace.h"
#include "client/image/read/exr_channels.h"
#include "client/image/read/exr_header.h"
#include "client/image/read/exr_windows.h"
#include "client/image/read/readers.h"

namespace candela {
namespace {

constexpr size_t kMaxLibraryText = 1000;  // characters of an OpenEXR error that are passed on

struct Part {
  int index = 0;
  ExrChannels channels;
};

absl::StatusOr<Part> choose_part(const std::string& path, const Imf::MultiPartInputFile& file) {
  bool deep = false;
  for (const bool lone : {false, true}) {
    for (int i = 0; i < file.parts(); ++i) {
      const Imf::Header& header = file.header(i);
      if (header.hasType() && Imf::isDeepData(header.type())) {
        deep = true;
      } else if (auto channels = choose_exr_channels(header.channels(), lone)) {
        return Part{i, *std::move(channels)};
      }
    }
  }
  if (deep) {
    return absl::UnimplementedError(
        absl::StrFormat("%s: this is a deep image, which cannot be rendered; flatten it first", path));
  }
  return absl::InvalidArgumentError(
      absl::StrFormat("%s: no colour channels (it has %s); it needs R G B, Y, Y RY BY or a single channel",
                      path, channel_names(file.header(0).channels())));
}

// The scan lines in a chunk (https://openexr.com/en/latest/OpenEXRFileLayout.html, "Scan line blocks").
int64_t rows_of_chunk(Imf::Compression compression) {
  switch (compression) {
    case Imf::NO_COMPRESSION:
    case Imf::RLE_COMPRESSION:
    case Imf::ZIPS_COMPRESSION:
      return 1;
    case Imf::ZIP_COMPRESSION:
    case Imf::PXR24_COMPRESSION:
      return 16;
    case Imf::PIZ_COMPRESSION:
    case Imf::B44_COMPRESSION:
    case Imf::B44A_COMPRESSION:
    case Imf::DWAA_COMPRESSION:
      return 32;
    default:
      return 256;  // DWAB has the tallest chunks
  }
}

absl::Status check_chunk(const std::string& path, const Imf::Header& header, const Window& data,
                         uint64_t max_bytes) {
  uint64_t pixel_bytes = 0;
  for (auto i = header.channels().begin(); i != header.channels().end(); ++i) {
    pixel_bytes += i.channel().type == Imf::HALF ? 2 : 4;
  }
  const int64_t rows = std::min(data.height(), rows_of_chunk(header.compression()));
  auto pixels = static_cast<uint64_t>(data.width() * rows);
  if (header.hasTileDescription()) {
    // OpenEXR holds a row of tiles while it returns scan lines from it.
    const Imf::TileDescription& tile = header.tileDescription();
    pixels = std::max(uint64_t{tile.xSize}, static_cast<uint64_t>(data.width())) * tile.ySize;
  }
  if (pixels > max_bytes || pixels * pixel_bytes > max_bytes) {
    return absl::ResourceExhaustedError(
        absl::StrFormat("%s: its chunks of %d pixels with %d bytes each exceed the limit of %d bytes; "
                        "store fewer channels or "
                        "smaller tiles",
                        path, pixels, pixel_bytes, max_bytes));
  }
  return absl::OkStatus();
}

absl::Status check_sampling(const std::string& path, const Imf::Header& header, const ExrChannels& channels) {
  for (const std::string& name : {channels.red, channels.green, channels.blue, channels.alpha}) {
    const Imf::Channel* channel = name.empty() ? nullptr : header.channels().findChannel(name);
    if (channel != nullptr && (channel->xSampling != 1 || channel->ySampling != 1)) {
      return absl::UnimplementedError(absl::StrFormat(
          "%s: channel %s is subsampled %dx%d, but only RY and BY may be; store it at full size", path,
          printable(name), channel->xSampling, channel->ySampling));
    }
  }
  return absl::OkStatus();
}

bool is_half(const Imf::Header& header, const ExrChannels& channels) {
  if (channels.kind == ExrChannels::Kind::kLumaChroma) return true;  // the RGBA interface is half
  for (const std::string& name : {channels.red, channels.green, channels.blue, channels.alpha}) {
    const Imf::Channel* channel = name.empty() ? nullptr : header.channels().findChannel(name);
    if (channel != nullptr && channel->type != Imf::HALF) return false;
  }
  return true;
}

ReadRows rgb_rows(Imf::InputPart& input, const ExrChannels& channels, const Image& image) {
  return [&](char* origin, size_t row_bytes, int64_t y0, int64_t y1) {
    const Imf::PixelType type = image.format == ImageFormat::kRgba16f ? Imf::HALF : Imf::FLOAT;
    const size_t pixel_bytes = bytes_per_pixel(image.format);
    const size_t component_bytes = pixel_bytes / 4;
    Imf::FrameBuffer frame;
    const std::string* const names[] = {&channels.red, &channels.green, &channels.blue, &channels.alpha};
    for (size_t c = 0; c < 4; ++c) {
      // OpenEXR fills a slice if the file lacks its channel, so this must be a name that no file uses.
      const std::string name = names[c]->empty() ? absl::StrCat("\x01", c) : *names[c];
      const double fill = c == 3 ? 1.0 : 0.0;
      frame.insert(name, Imf::Slice(type, origin + c * component_bytes, pixel_bytes, row_bytes, 1, 1, fill));
    }
    input.setFrameBuffer(frame);
    input.readPixels(static_cast<int>(y0), static_cast<int>(y1));
  };
}

ReadRows luma_chroma_rows(Imf::RgbaInputFile& input) {
  return [&](char* origin, size_t row_bytes, int64_t y0, int64_t y1) {
    input.setFrameBuffer(reinterpret_cast<Imf::Rgba*>(origin), 1, row_bytes / sizeof(Imf::Rgba));
    input.readPixels(static_cast<int>(y0), static_cast<int>(y1));
  };
}

void read_attributes(const Imf::Header& header, Image& image) {
  set_pixel_aspect(header.pixelAspectRatio(), image);
  if (Imf::hasFramesPerSecond(header)) {
    const Imf::Rational& rate = Imf::framesPerSecond(header);
    if (rate.n > 0 && rate.d > 0) image.frame_rate = FrameRate{static_cast<uint64_t>(rate.n), rate.d};
  }
  if (Imf::hasChromaticities(header)) {
    const Imf::Chromaticities& c = Imf::chromaticities(header);
    set_chromaticities({c.red.x, c.red.y, c.green.x, c.green.y, c.blue.x, c.blue.y, c.white.x, c.white.y},
                       image);
  }
}

absl::StatusOr<Image> read_open_file(const std::string& path, Imf::MultiPartInputFile& file,
                                     const ImageLimits& limits) {
  absl::StatusOr<Part> part = choose_part(path, file);
  if (!part.ok()) return part.status();
  const ExrChannels& channels = part->channels;
  const Imf::Header& header = file.header(part->index);
  const Window data(header.dataWindow()), display(header.displayWindow());
  const ImageFormat format = is_half(header, channels) ? ImageFormat::kRgba16f : ImageFormat::kRgba32f;
  absl::Status status = check_image_size(path, "image", display.width(), display.height(), format, limits);
  status.Update(check_image_size(path, "data window", data.width(), data.height(), format, limits));
  status.Update(check_chunk(path, header, data, limits.max_chunk_bytes));
  status.Update(check_sampling(path, header, channels));
  if (!status.ok()) return status;

  absl::StatusOr<Image> image =
      make_image(static_cast<uint32_t>(display.width()), static_cast<uint32_t>(display.height()), format);
  if (!image.ok()) return image;
  const bool covered =
      data.x0 <= display.x0 && data.y0 <= display.y0 && data.x1 >= display.x1 && data.y1 >= display.y1;
  image->has_alpha = !channels.alpha.empty() || !covered;
  read_attributes(header, *image);
  if (part->index > 0) {
    image->notes.push_back(absl::StrFormat("part %d of %d, %s, is shown", part->index + 1, file.parts(),
                                           header.hasName() ? printable(header.name()) : "unnamed"));
  }
  if (!channels.layer.empty())
    image->notes.push_back(absl::StrFormat("layer %s is shown", printable(channels.layer)));

  if (channels.kind == ExrChannels::Kind::kLumaChroma) {
    if (part->index > 0) {
      return absl::UnimplementedError(
          absl::StrFormat("%s: luminance-chroma channels can only be read from the first part; these are in "
                          "part %d; store R G B",
                          path, part->index + 1));
    }
    Imf::RgbaInputFile input(path.c_str(), channels.layer);
    read_windows(data, display, false, luma_chroma_rows(input), *image);
  } else {
    Imf::InputPart input(file, part->index);
    const bool grey = channels.kind == ExrChannels::Kind::kGrey;
    read_windows(data, display, grey, rgb_rows(input, channels, *image), *image);
  }
  return image;
}

}  // namespace

absl::StatusOr<Image> read_exr(FileReader& opened, const ImageLimits& limits) {
  if (absl::Status status = check_exr_header(opened); !status.ok()) return status;
  const std::string& path = opened.path();
  try {
    Imf::MultiPartInputFile file(path.c_str());
    return read_open_file(path, file, limits);
  } catch (const std::bad_alloc&) {
    return absl::ResourceExhaustedError(
        absl::StrFormat("%s: not enough memory to decode it; scale it down", path));
  } catch (const std::exception& error) {
    // Removes the file's name, which the library adds and our message has already. The text may quote the
    // file's content.
    const std::string quoted = absl::StrCat(" \"", path, "\"");
    const std::string text =
        absl::StrReplaceAll(error.what(), {{absl::string_view(quoted), ""}, {"\n", " "}});
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: damaged OpenEXR file: %s", path, printable(text, kMaxLibraryText)));
  }
}

}  // namespace candela
