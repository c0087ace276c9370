#include "client/image/read/exr/exr_checks.h"

#include <OpenEXR/ImfChannelList.h>

#include <algorithm>

#include "absl/strings/str_format.h"
#include "client/image/read/exr/exr_windows.h"
#include "client/image/read/readers.h"

namespace candela {
namespace {

struct Chunk {
  uint64_t pixels = 0, pixel_bytes = 0;
};

Chunk chunk_of(const Imf::Header& header) {
  const Window data(header.dataWindow());
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
  return {pixels, pixel_bytes};
}

absl::Status check_chunk(const std::string& path, const Imf::Header& header, uint64_t max_bytes) {
  const auto [pixels, pixel_bytes] = chunk_of(header);
  if (pixels > max_bytes || pixels * pixel_bytes > max_bytes) {
    return absl::ResourceExhaustedError(
        absl::StrFormat("%s: its chunks of %d pixels with %d bytes each exceed the limit of %d bytes; store "
                        "fewer channels or smaller tiles, or raise the limit with --max-chunk-mib, "
                        "for which %d MiB are enough",
                        path, pixels, pixel_bytes, max_bytes, (pixels * pixel_bytes >> 20) + 1));
  }
  return absl::OkStatus();
}

absl::Status check_sampling(const std::string& path, const Imf::Header& header, const ExrChannels& channels) {
  const bool luma = channels.kind == ExrChannels::Kind::kLumaChroma;
  const std::string y = luma ? channels.prefix + "Y" : "";
  for (const std::string& name : {channels.red, channels.green, channels.blue, channels.alpha, y}) {
    const Imf::Channel* channel = name.empty() ? nullptr : header.channels().findChannel(name);
    if (channel != nullptr && (channel->xSampling != 1 || channel->ySampling != 1)) {
      return absl::UnimplementedError(absl::StrFormat(
          "%s: channel %s is subsampled %dx%d, but only RY and BY may be; store it at full size", path,
          shown_name(name), channel->xSampling, channel->ySampling));
    }
  }
  for (const char* name : {"RY", "BY"}) {
    const Imf::Channel* channel = luma ? header.channels().findChannel(channels.prefix + name) : nullptr;
    if (channel != nullptr && (channel->xSampling != 2 || channel->ySampling != 2)) {
      return absl::UnimplementedError(
          absl::StrFormat("%s: channel %s is subsampled %dx%d, but RY and BY must be 2x2; store R G B", path,
                          shown_name(channels.prefix + name), channel->xSampling, channel->ySampling));
    }
  }
  return absl::OkStatus();
}

}  // namespace

// https://openexr.com/en/latest/OpenEXRFileLayout.html, "Scan line blocks".
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

ImageFormat exr_format(const Imf::Header& header, const ExrChannels& channels) {
  // The RGBA interface is half.
  if (channels.kind == ExrChannels::Kind::kLumaChroma) return ImageFormat::kRgba16f;
  for (const std::string& name : {channels.red, channels.green, channels.blue, channels.alpha}) {
    const Imf::Channel* channel = name.empty() ? nullptr : header.channels().findChannel(name);
    if (channel != nullptr && channel->type != Imf::HALF) return ImageFormat::kRgba32f;
  }
  return ImageFormat::kRgba16f;
}

uint64_t chunk_bytes(const Imf::Header& header) {
  const auto [pixels, pixel_bytes] = chunk_of(header);
  return pixels * pixel_bytes;
}

absl::Status check_exr_picture(const std::string& path, const Imf::Header& header,
                               const ExrChannels& channels, const ImageLimits& limits) {
  const Window data(header.dataWindow()), display(header.displayWindow());
  const ImageFormat format = exr_format(header, channels);
  absl::Status status = check_image_size(path, "image", display.width(), display.height(), format, limits);
  status.Update(check_image_size(path, "data window", data.width(), data.height(), format, limits));
  status.Update(check_chunk(path, header, limits.max_chunk_bytes));
  status.Update(check_sampling(path, header, channels));
  return status;
}

}  // namespace candela
