#include "client/image/read/exr_file.h"

#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfCompression.h>
#include <OpenEXR/ImfIO.h>
#include <OpenEXR/ImfMultiView.h>
#include <OpenEXR/ImfStandardAttributes.h>
#include <OpenEXR/ImfVersion.h>
#include <OpenEXR/OpenEXRConfig.h>

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <exception>
#include <initializer_list>
#include <memory>
#include <new>
#include <span>
#include <stdexcept>
#include <string>
#include <utility>

#include "absl/algorithm/container.h"
#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/string_view.h"
#include "client/base/failure.h"
#include "client/image/read/exr_zip.h"
#include "client/image/read/readers.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

// The name up to and including its last dot; "" for a plain name.
std::string prefix_of(const std::string& name) { return name.substr(0, name.rfind('.') + 1); }

// The layer's channel of one of these names, "" if there is none.
std::string find(const ExrLayer& layer, std::initializer_list<const char*> names) {
  const auto base = [&](const std::string& channel) {
    return absl::string_view(channel).substr(layer.prefix.size());
  };
  for (const char* name : names) {
    for (const std::string& channel : layer.channels) {
      if (base(channel) == name) return channel;
    }
    for (const std::string& channel : layer.channels) {
      if (absl::EqualsIgnoreCase(base(channel), name)) return channel;
    }
  }
  return "";
}

bool has(const ExrLayer& layer, const char* base) {
  return absl::c_linear_search(layer.channels, layer.prefix + base);
}

std::string alpha_of(const ExrLayer& layer) { return find(layer, {"A", "alpha"}); }

// Colours whose names have no dot before R, G and B: LeR, LeG and LeB, or beauty_r, beauty_g and beauty_b.
// Takes them out of a layer and returns them as layers.
std::vector<ExrLayer> split_off_colours(ExrLayer& layer) {
  constexpr const char* kEnds[][4] = {{"R", "G", "B", "A"},
                                      {"r", "g", "b", "a"},
                                      {"Red", "Green", "Blue", "Alpha"},
                                      {"red", "green", "blue", "alpha"}};
  std::vector<ExrLayer> layers;
  for (const std::string& red : std::vector<std::string>(layer.channels)) {
    for (const auto& ends : kEnds) {
      if (red.size() <= layer.prefix.size() + std::strlen(ends[0]) || !absl::EndsWith(red, ends[0])) continue;
      const std::string prefix = red.substr(0, red.size() - std::strlen(ends[0]));
      // AR, AG and AB are the alphas of the colours, and a small letter after a letter may be any word's.
      const char last = prefix.back();
      const bool begins = !absl::ascii_isalpha(static_cast<unsigned char>(last)) ||
                          (absl::ascii_islower(static_cast<unsigned char>(last)) &&
                           absl::ascii_isupper(static_cast<unsigned char>(*ends[0])));
      if (!begins) continue;
      std::vector<std::string> channels;
      for (const char* end : ends) {
        if (absl::c_binary_search(layer.channels, prefix + end)) channels.push_back(prefix + end);
      }
      if (channels.size() < 3 || channels[2] != prefix + ends[2]) continue;
      std::string name = layer.name + (layer.name.empty() ? "" : ".") + prefix.substr(layer.prefix.size());
      while (name.size() > 1 && absl::ascii_ispunct(static_cast<unsigned char>(name.back()))) name.pop_back();
      std::erase_if(layer.channels, [&](const std::string& c) { return absl::c_linear_search(channels, c); });
      layers.push_back({layer.view, std::move(name), prefix, std::move(channels)});
      break;
    }
  }
  return layers;
}

}  // namespace

std::vector<ExrLayer> layers_of(const Imf::Header& header) {
  const Imf::StringVector views = Imf::hasMultiView(header) ? Imf::multiView(header) : Imf::StringVector();
  std::vector<ExrLayer> layers;
  for (auto i = header.channels().begin(); i != header.channels().end(); ++i) {
    const std::string channel = i.name(), prefix = prefix_of(channel);
    auto layer = absl::c_find_if(layers, [&](const ExrLayer& l) { return l.prefix == prefix; });
    if (layer == layers.end()) {
      const std::string view = !views.empty()     ? Imf::viewFromChannelName(channel, views)
                               : header.hasView() ? header.view()
                                                  : "";
      std::string name =
          views.empty() || view.empty() ? prefix : prefix_of(Imf::removeViewName(channel, view));
      if (!name.empty()) name.pop_back();
      layer = layers.insert(layers.end(), {view, std::move(name), prefix});
    }
    layer->channels.push_back(channel);
  }
  for (size_t i = layers.size(); i-- > 0;) {
    std::vector<ExrLayer> colours = split_off_colours(layers[i]);
    if (layers[i].channels.empty()) layers.erase(layers.begin() + static_cast<std::ptrdiff_t>(i));
    layers.insert(layers.end(), colours.begin(), colours.end());
  }
  const std::string first = Imf::defaultViewName(views);
  absl::c_stable_sort(layers, [&](const ExrLayer& a, const ExrLayer& b) {
    const auto order = [&](const ExrLayer& l) { return std::pair(l.view != first, !l.name.empty()); };
    return order(a) < order(b);
  });
  return layers;
}

std::optional<ExrChannels> colour_of(const ExrLayer& layer) {
  ExrChannels chosen{.prefix = layer.prefix,
                     .red = find(layer, {"R", "red"}),
                     .green = find(layer, {"G", "green"}),
                     .blue = find(layer, {"B", "blue"}),
                     .alpha = alpha_of(layer)};
  const int primaries = !chosen.red.empty() + !chosen.green.empty() + !chosen.blue.empty();
  if (primaries >= 2) return chosen;
  if (has(layer, "Y") && has(layer, "RY") && has(layer, "BY")) {
    chosen.kind = ExrChannels::Kind::kLumaChroma;
    // OpenEXR decodes these three, and only A beside them.
    if (chosen.alpha != layer.prefix + "A") chosen.alpha.clear();
    return chosen;
  }
  chosen.kind = ExrChannels::Kind::kGrey;
  const std::string luminance = find(layer, {"Y"});
  if (primaries == 1) {
    chosen.red = absl::StrCat(chosen.red, chosen.green, chosen.blue);
  } else if (!luminance.empty() && find(layer, {"X"}).empty()) {  // X and Y make a vector
    chosen.red = luminance;
  } else {
    return std::nullopt;
  }
  chosen.green.clear();
  chosen.blue.clear();
  return chosen;
}

std::optional<ExrChannels> data_of(const ExrLayer& layer) {
  ExrChannels vector{.prefix = layer.prefix,
                     .red = find(layer, {"X"}),
                     .green = find(layer, {"Y"}),
                     .blue = find(layer, {"Z"}),
                     .alpha = alpha_of(layer)};
  if (has_xyz(layer)) return vector;
  std::vector<std::string> values = layer.channels;
  std::erase(values, vector.alpha);
  if (values.size() == 3) {
    vector.red = values[0], vector.green = values[1], vector.blue = values[2];
    return vector;
  }
  if (values.size() != 1) return std::nullopt;
  return ExrChannels{
      .kind = ExrChannels::Kind::kGrey, .prefix = layer.prefix, .red = values.front(), .alpha = vector.alpha};
}

bool has_xyz(const ExrLayer& layer) {
  return !find(layer, {"X"}).empty() && !find(layer, {"Y"}).empty() && !find(layer, {"Z"}).empty();
}

std::string shown_name(const std::string& name) {
  constexpr size_t kMostBytes = 255;  // of a channel's name
  return printable(name, kMostBytes);
}

bool is_called(const std::string& name, const std::string& choice) {
  return name == choice || shown_name(name) == choice;
}

std::string name_list(const std::vector<std::string>& names) {
  constexpr size_t kShown = 12;
  std::vector<std::string> shown;
  for (const std::string& name : names) {
    if (shown.size() == kShown) {
      shown.push_back("...");
      break;
    }
    shown.push_back(shown_name(name));
  }
  return absl::StrJoin(shown, ", ");
}

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

namespace {

constexpr size_t kMaxLibraryText = 1000;  // characters of an OpenEXR error that are passed on

// OpenEXR's stream interface for a FileReader. OpenEXR's own stream reads nothing more once it has met the
// file's end, so a chunk beyond it would hide those before.
class FileStream : public Imf::IStream {
 public:
  explicit FileStream(FileReader& file) : Imf::IStream(file.path().c_str()), file_(file) {}
  bool read(char* bytes, int count) override {
    const auto wanted = static_cast<uint64_t>(count);
    if (at_ > file_.size() || wanted > file_.size() - at_ || (file_.position() != at_ && !file_.seek(at_)) ||
        !file_.read(std::as_writable_bytes(std::span(bytes, wanted)))) {
      throw std::runtime_error(kFileEnds);
    }
    at_ += wanted;
    return at_ < file_.size();
  }
  uint64_t tellg() override { return at_; }
  void seekg(uint64_t position) override { at_ = position; }

 private:
  FileReader& file_;
  uint64_t at_ = 0;
};

constexpr uint32_t kMultiPart = 1u << 12;  // in the version field

bool read_u32(FileReader& file, uint32_t& value) {
  value = 0;
  for (int shift = 0; shift < 32; shift += 8) {
    const int byte = file.get();
    if (byte < 0) return false;
    value |= static_cast<uint32_t>(byte) << shift;
  }
  return true;
}

// Takes a name up to its zero byte. False if it is longer than the 255 letters that a name may have.
bool read_name(FileReader& file, std::string& name) {
  name.clear();
  for (int byte = file.get(); byte != 0; byte = file.get()) {
    if (byte < 0 || name.size() == 255) return false;
    name.push_back(static_cast<char>(byte));
  }
  return true;
}

// The sizes in bytes of types that OpenEXR knows. It reads that many bytes, whatever the file claims.
constexpr std::pair<absl::string_view, uint32_t> kFixedSizes[] = {
    {"box2f", 16},
    {"box2i", 16},
    {"chromaticities", 32},
    {"compression", 1},
    {"deepImageState", 1},
    {"double", 8},
    {"envmap", 1},
    {"float", 4},
    {"int", 4},
    {"keycode", 28},
    {"lineOrder", 1},
    {"m33d", 72},
    {"m33f", 36},
    {"m44d", 128},
    {"m44f", 64},
    {"rational", 8},
    {"tiledesc", 9},
    {"timecode", 8},
    {"v2d", 16},
    {"v2f", 8},
    {"v2i", 8},
    {"v3d", 24},
    {"v3f", 12},
    {"v3i", 12},
};

// Takes the value of an attribute. False if the value does not have the size that it claims. Then OpenEXR
// would continue reading at the wrong place or allocate memory of another size.
bool take_value(FileReader& file, const std::string& type, uint32_t size) {
  const uint64_t end = file.remaining() - size;
  for (const auto& [fixed, bytes] : kFixedSizes) {
    if (type == fixed && size != bytes) return false;
  }
  std::string name;
  uint32_t width = 0, height = 0, length = 0;
  if (type == "chlist") {
    constexpr uint32_t kChannelBytes = 16;
    do {
      if (!read_name(file, name) || (!name.empty() && !file.skip(kChannelBytes))) return false;
    } while (!name.empty());
    return file.remaining() == end;
  }
  if (type == "preview") {
    return size >= 8 && read_u32(file, width) && read_u32(file, height) && width <= size && height <= size &&
           uint64_t{size} == 8 + uint64_t{4} * width * height && file.skip(size - 8);
  }
  if (type == "stringvector") {
    while (file.remaining() > end) {
      if (!read_u32(file, length) || !file.skip(length)) return false;
    }
    return file.remaining() == end;
  }
  return file.skip(size);
}

// UNIMPLEMENTED for a version of the format, or a kind of file, that this OpenEXR does not know.
absl::Status check_version(const std::string& path, uint32_t version) {
  const bool known = static_cast<int>(version & Imf::VERSION_NUMBER_FIELD) <= Imf::EXR_VERSION &&
                     Imf::supportsFlags(static_cast<int>(version & Imf::VERSION_FLAGS_FIELD));
  if (known) return absl::OkStatus();
  return absl::UnimplementedError(absl::StrFormat(
      "%s: version %d of OpenEXR's format, with flags %#x, is newer than OpenEXR %s, which this "
      "candela has; save it with an older program",
      path, version & Imf::VERSION_NUMBER_FIELD, version & Imf::VERSION_FLAGS_FIELD, OPENEXR_VERSION_STRING));
}

// Looks at the value of the attribute `compression`. UNIMPLEMENTED if this OpenEXR does not know it.
absl::Status check_compression(FileReader& file) {
  ASSIGN_OR_RETURN(const std::string byte, file.peek(1));
  const int number = byte.empty() ? 0 : static_cast<unsigned char>(byte.front());
  if (number < Imf::NUM_COMPRESSION_METHODS) return absl::OkStatus();
  // https://openexr.com/en/latest/OpenEXRFileLayout.html, "compression"
  const std::string what = number == 10   ? "HTJ2K256, which OpenEXR 3.4 and later read"
                           : number == 11 ? "HTJ2K32, which OpenEXR 3.4 and later read"
                                          : "which a later OpenEXR may read";
  return absl::UnimplementedError(absl::StrFormat(
      "%s: its compression is number %d, %s; this candela has OpenEXR %s, so save it with ZIP (such as "
      "oiiotool IN.exr --compression zip -o OUT.exr)",
      file.path(), number, what, OPENEXR_VERSION_STRING));
}

// OpenEXR 3.1 allocates as much memory for an attribute as the file claims, which may be gigabytes for a file
// of 200 bytes. This function walks over the attributes of every part (see "file layout" in the Technical
// Introduction to OpenEXR). It returns INVALID_ARGUMENT if an attribute is larger than the rest of the file
// or the header does not end, and UNIMPLEMENTED if this OpenEXR does not know the version of the format or a
// part's compression. It leaves checking the other values to OpenEXR.
absl::Status check_exr_header(FileReader& file) {
  uint32_t magic = 0, version = 0, size = 0;
  std::string name, type;
  bool whole = read_u32(file, magic) && read_u32(file, version);
  if (absl::Status known = check_version(file.path(), version); whole && !known.ok()) return known;
  const bool multi_part = (version & kMultiPart) != 0;
  int attributes = 0;
  while (whole) {
    whole = read_name(file, name);
    if (whole && name.empty()) {
      // The end of a part's header. In a multi-part file an empty header ends the list.
      if (!multi_part || attributes == 0) return absl::OkStatus();
      attributes = 0;
      continue;
    }
    ++attributes;
    whole = whole && read_name(file, type) && read_u32(file, size);
    if (whole && size > file.remaining()) {
      return absl::InvalidArgumentError(
          absl::StrFormat("%s: damaged OpenEXR file: attribute %s claims %d bytes, but only %d are left",
                          file.path(), printable(name), size, file.remaining()));
    }
    if (whole && type == "compression" && size == 1) {
      RETURN_IF_ERROR(check_compression(file));
    }
    if (whole && !take_value(file, type, size)) {
      return absl::InvalidArgumentError(
          absl::StrFormat("%s: damaged OpenEXR file: attribute %s does not have the %d bytes that it claims",
                          file.path(), printable(name), size));
    }
  }
  return absl::InvalidArgumentError(absl::StrFormat(
      "%s: damaged OpenEXR file: the header is not a complete list of attributes", file.path()));
}

}  // namespace

std::unique_ptr<Imf::IStream> stream_of(FileReader& opened) { return std::make_unique<FileStream>(opened); }

absl::Status with_exr_file(FileReader& opened,
                           absl::FunctionRef<absl::Status(Imf::MultiPartInputFile& file)> use, int threads) {
  opened.seek(0);
  RETURN_IF_ERROR(check_exr_header(opened));
  const std::string& path = opened.path();
  try {
    FileStream stream(opened);
    Imf::MultiPartInputFile file(stream, threads);
    return use(file);
  } catch (const std::bad_alloc&) {
    return failure_of(
        FailureKind::kOther,
        absl::ResourceExhaustedError(absl::StrFormat(
            "%s: not enough memory to decode it; give this process more, or scale it down", path)));
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
