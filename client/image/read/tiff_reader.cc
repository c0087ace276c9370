// Reads TIFF and BigTIFF files by libtiff: grey, RGB, CMYK and palettes, of integers up to 16 bits or floats,
// in strips or tiles. Of several pictures the first is read that is no preview of another one. Integers are a
// signal, as a PNG's are; floats are light, if no profile says otherwise.
#include <half.h>
#include <tiffio.h>

#include <algorithm>
#include <array>
#include <cstdarg>
#include <cstdio>
#include <cstring>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/strip.h"
#include "client/image/color.h"
#include "client/image/read/exif.h"
#include "client/image/read/icc_profile.h"
#include "client/image/read/readers.h"
#include "client/image/read/signal.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

constexpr size_t kMostErrorBytes = 200;
constexpr uint16_t kMostSamples = 64;   // a pixel
constexpr int kMostDirectories = 32;    // that are looked at
constexpr uint16_t kLinearRaw = 34892;  // Source: DNG 1.7
constexpr char kIccSource[] = "ICC";
constexpr ImageFormat kTiffFormat = ImageFormat::kRgba32f;
constexpr size_t kPixelBytes = bytes_per_pixel(kTiffFormat);

// A file as libtiff reads it, and the first error that libtiff reports.
class TiffInput {
 public:
  // libtiff takes no piece of memory of more than `max_bytes`.
  TiffInput(FileReader& file, uint64_t max_bytes) : file_(file) {
    const std::unique_ptr<TIFFOpenOptions, decltype(&TIFFOpenOptionsFree)> options(TIFFOpenOptionsAlloc(),
                                                                                   &TIFFOpenOptionsFree);
    if (options == nullptr) return;
    TIFFOpenOptionsSetMaxSingleMemAlloc(options.get(), static_cast<tmsize_t>(max_bytes));
    TIFFOpenOptionsSetErrorHandlerExtR(options.get(), fail, this);
    TIFFOpenOptionsSetWarningHandlerExtR(options.get(), warn, nullptr);
    tiff_ = TIFFClientOpenExt("", "r", this, read, write, seek, close, size, nullptr, nullptr, options.get());
  }
  ~TiffInput() {
    if (tiff_ != nullptr) TIFFClose(tiff_);
  }
  TiffInput(const TiffInput&) = delete;
  TiffInput& operator=(const TiffInput&) = delete;

  TIFF* get() const { return tiff_; }  // null if it has no picture
  const std::string& path() const { return file_.path(); }
  absl::Status damaged() const {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: damaged TIFF file: %s", path(), error_.empty() ? "it has no picture" : error_));
  }
  // Some of libtiff's errors begin with the name that it was given, which is none.
  void set_error(absl::string_view error) {
    error_ = printable(absl::StripPrefix(error, ": "), kMostErrorBytes);
  }

 private:
  static TiffInput& self(thandle_t handle) { return *static_cast<TiffInput*>(handle); }
  static tmsize_t read(thandle_t handle, void* to, tmsize_t count) {
    FileReader& file = self(handle).file_;
    const uint64_t from = file.position();
    (void)file.read({static_cast<std::byte*>(to), static_cast<size_t>(count)});
    return static_cast<tmsize_t>(file.position() - from);
  }
  static tmsize_t write(thandle_t, void*, tmsize_t) { return 0; }
  static toff_t seek(thandle_t handle, toff_t offset, int from) {
    FileReader& file = self(handle).file_;
    const uint64_t base = from == SEEK_SET ? 0 : from == SEEK_CUR ? file.position() : file.size();
    return file.seek(base + offset) ? base + offset : static_cast<toff_t>(-1);
  }
  static int close(thandle_t) { return 0; }
  static toff_t size(thandle_t handle) { return self(handle).file_.size(); }
  static int fail(TIFF*, void* handle, const char*, const char* format, va_list arguments) {
    TiffInput& input = self(handle);
    char error[kMostErrorBytes] = "";
    std::vsnprintf(error, sizeof error, format, arguments);
    if (input.error_.empty()) input.set_error(error);
    return 1;  // libtiff prints nothing
  }
  static int warn(TIFF*, void*, const char*, const char*, va_list) { return 1; }

  FileReader& file_;
  std::string error_;
  TIFF* tiff_ = nullptr;
};

template <typename Value>
Value field(TIFF* tiff, uint32_t tag) {
  Value value{};
  TIFFGetFieldDefaulted(tiff, tag, &value);
  return value;
}

// ---- What the header says ----

// The samples of a picture, as libtiff gives them.
struct TiffLayout {
  uint32_t width = 0, height = 0;
  uint16_t samples = 1;  // a pixel
  uint16_t bits = 1;     // a sample: 1 .. 16, or of floats 16 or 32
  bool floats = false;
  bool separate = false;  // the samples are in planes of their own
  bool tiled = false;
  uint16_t photometric = PHOTOMETRIC_MINISBLACK;
  uint16_t colors = 1;  // the samples of colour, which come first: 1 (grey, palette), 3, or 4 (CMYK)
  std::optional<uint16_t> alpha{};  // the sample that is alpha
  bool associated = false;          // it has multiplied the colours
  bool by_libtiff = false;  // its TIFFRGBAImage decodes all, to 8 bits of R, G, B and associated alpha
};

absl::Status camera_raw(const TiffInput& input) {
  return absl::UnimplementedError(absl::StrFormat(
      "%s: it shows only a preview, as a camera's raw file does; develop it to a TIFF or OpenEXR file",
      input.path()));
}

// Goes to the first picture that is neither a preview nor a mask of another one; without any, to the first.
absl::Status find_picture(TiffInput& input, std::vector<std::string>& notes) {
  TIFF* const tiff = input.get();
  int first = -1, pictures = 0, directory = 0;
  do {
    const auto kind = field<uint32_t>(tiff, TIFFTAG_SUBFILETYPE);
    if ((kind & (FILETYPE_REDUCEDIMAGE | FILETYPE_MASK)) != 0) continue;
    if (first < 0) first = directory;
    ++pictures;
  } while (pictures < 2 && ++directory < kMostDirectories && TIFFReadDirectory(tiff) != 0);
  if (pictures > 1) notes.emplace_back("the first of its pictures is shown");
  input.set_error("");  // of a later directory
  if (TIFFSetDirectory(tiff, static_cast<tdir_t>(std::max(first, 0))) == 0) return input.damaged();
  uint16_t count = 0;
  const uint64_t* places = nullptr;
  const bool has_more = TIFFGetField(tiff, TIFFTAG_SUBIFD, &count, &places) != 0;
  return first < 0 && has_more ? camera_raw(input) : absl::OkStatus();
}

absl::Status not_read(const TiffInput& input, const std::string& what) {
  return absl::UnimplementedError(
      absl::StrFormat("%s: %s; Candela reads grey, RGB, CMYK and palettes, as unsigned integers of 1 to 16 "
                      "bits or floats of 16 or 32; convert it to one of these",
                      input.path(), what));
}

// How many samples are colours; 0 of a kind that cannot be read.
uint16_t colors_of(TIFF* tiff, uint16_t photometric) {
  switch (photometric) {
    case PHOTOMETRIC_MINISWHITE:
    case PHOTOMETRIC_MINISBLACK:
    case PHOTOMETRIC_PALETTE:
      return 1;
    case PHOTOMETRIC_RGB:
    case PHOTOMETRIC_LOGLUV:
      return 3;
    case PHOTOMETRIC_SEPARATED:
      return field<uint16_t>(tiff, TIFFTAG_INKSET) == INKSET_CMYK ? 4 : 0;
    default:
      return 0;
  }
}

const char* words_of_photometric(uint16_t photometric) {
  switch (photometric) {
    case PHOTOMETRIC_SEPARATED:
      return "inks other than CMYK";
    case PHOTOMETRIC_MASK:
      return "a mask";
    case PHOTOMETRIC_CIELAB:
    case PHOTOMETRIC_ICCLAB:
    case PHOTOMETRIC_ITULAB:
      return "L*a*b*";
    case PHOTOMETRIC_CFA:
    case kLinearRaw:
      return "a camera's raw samples";
    default:
      return "of a kind without a name here";
  }
}

const char* words_of_samples(uint16_t format) {
  switch (format) {
    case SAMPLEFORMAT_INT:
      return "signed integers";
    case SAMPLEFORMAT_IEEEFP:
      return "floats";
    case SAMPLEFORMAT_COMPLEXINT:
    case SAMPLEFORMAT_COMPLEXIEEEFP:
      return "complex numbers";
    default:
      return "unsigned integers";
  }
}

absl::Status check_compression(const TiffInput& input, uint16_t compression) {
  // The memory that these decoders take is not limited, and JBIG's ends the process if there is not enough.
  constexpr std::array kUnlimited = {COMPRESSION_OJPEG, COMPRESSION_LZMA, COMPRESSION_JBIG};
  if (TIFFIsCODECConfigured(compression) != 0 && std::ranges::count(kUnlimited, compression) == 0) {
    return absl::OkStatus();
  }
  const TIFFCodec* const codec = TIFFFindCODEC(compression);
  return absl::UnimplementedError(
      absl::StrFormat("%s: its compression is %s, which is not read; save it with Deflate or LZW",
                      input.path(), codec != nullptr ? codec->name : absl::StrCat("number ", compression)));
}

// Has libtiff decode what it can turn into grey or RGB.
void choose_decoding(TIFF* tiff, uint16_t compression, TiffLayout& layout) {
  uint16_t& photometric = layout.photometric;
  if (compression == COMPRESSION_SGILOG || compression == COMPRESSION_SGILOG24) {
    TIFFSetField(tiff, TIFFTAG_SGILOGDATAFMT, SGILOGDATAFMT_FLOAT);
    if (photometric == PHOTOMETRIC_LOGL) photometric = PHOTOMETRIC_MINISBLACK;
  }
  if (photometric == PHOTOMETRIC_YCBCR) {
    const bool to_rgb = compression == COMPRESSION_JPEG && !layout.separate;
    if (to_rgb) TIFFSetField(tiff, TIFFTAG_JPEGCOLORMODE, JPEGCOLORMODE_RGB);
    photometric = PHOTOMETRIC_RGB;
    layout.by_libtiff = !to_rgb;
  }
}

// Finds alpha among the samples behind the colours.
void find_alpha(TIFF* tiff, TiffLayout& layout, std::vector<std::string>& notes) {
  uint16_t count = 0;
  const uint16_t* kinds = nullptr;
  TIFFGetFieldDefaulted(tiff, TIFFTAG_EXTRASAMPLES, &count, &kinds);
  for (uint16_t i = 0; i < count && layout.colors + i < layout.samples && !layout.alpha; ++i) {
    if (kinds[i] == EXTRASAMPLE_UNSPECIFIED) continue;
    layout.alpha = static_cast<uint16_t>(layout.colors + i);
    layout.associated = kinds[i] == EXTRASAMPLE_ASSOCALPHA;
  }
  const int unused = layout.samples - layout.colors - (layout.alpha ? 1 : 0);
  if (unused > 0) {
    notes.push_back(absl::StrFormat("%d of its %d samples a pixel are neither colour nor alpha, and not used",
                                    unused, layout.samples));
  }
}

absl::StatusOr<TiffLayout> layout_of(const TiffInput& input, std::vector<std::string>& notes) {
  TIFF* const tiff = input.get();
  TiffLayout layout{.width = field<uint32_t>(tiff, TIFFTAG_IMAGEWIDTH),
                    .height = field<uint32_t>(tiff, TIFFTAG_IMAGELENGTH),
                    .samples = field<uint16_t>(tiff, TIFFTAG_SAMPLESPERPIXEL),
                    .separate = field<uint16_t>(tiff, TIFFTAG_PLANARCONFIG) == PLANARCONFIG_SEPARATE,
                    .tiled = TIFFIsTiled(tiff) != 0};
  const auto compression = field<uint16_t>(tiff, TIFFTAG_COMPRESSION);
  RETURN_IF_ERROR(check_compression(input, compression));
  if (TIFFGetField(tiff, TIFFTAG_PHOTOMETRIC, &layout.photometric) == 0) {
    layout.photometric = layout.samples < 3 ? PHOTOMETRIC_MINISBLACK : PHOTOMETRIC_RGB;
  }
  const uint16_t named = layout.photometric;
  choose_decoding(tiff, compression, layout);
  layout.colors = colors_of(tiff, layout.photometric);
  if (layout.colors == 0) {
    return not_read(input, absl::StrFormat("its colours are %s (photometric interpretation %d)",
                                           words_of_photometric(named), named));
  }
  layout.bits = field<uint16_t>(tiff, TIFFTAG_BITSPERSAMPLE);
  const auto format = field<uint16_t>(tiff, TIFFTAG_SAMPLEFORMAT);
  layout.floats = format == SAMPLEFORMAT_IEEEFP;
  const bool integers = format == SAMPLEFORMAT_UINT || format == SAMPLEFORMAT_VOID;
  const bool grey_or_rgb = layout.photometric == PHOTOMETRIC_MINISBLACK ||
                           layout.photometric == PHOTOMETRIC_RGB || layout.photometric == PHOTOMETRIC_LOGLUV;
  if (layout.floats ? !grey_or_rgb || (layout.bits != 16 && layout.bits != 32)
                    : !integers || layout.bits < 1 || layout.bits > 16) {
    return not_read(input, absl::StrFormat("its samples are %s of %d bits (photometric interpretation %d)",
                                           words_of_samples(format), layout.bits, named));
  }
  if (layout.samples < layout.colors || layout.samples > kMostSamples) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: it has %d samples a pixel; its colours need %d, and %d is the limit",
                        input.path(), layout.samples, layout.colors, kMostSamples));
  }
  uint16_t *red = nullptr, *green = nullptr, *blue = nullptr;
  if (layout.photometric == PHOTOMETRIC_PALETTE &&
      TIFFGetField(tiff, TIFFTAG_COLORMAP, &red, &green, &blue) == 0) {
    return absl::InvalidArgumentError(input.path() +
                                      ": damaged TIFF file: its palette (ColorMap) is missing");
  }
  find_alpha(tiff, layout, notes);
  if (layout.by_libtiff) {
    layout.bits = 8;
    layout.samples = 4;
    layout.colors = 3;
    layout.separate = false;
    layout.associated = true;
    if (layout.alpha) layout.alpha = 3;
  }
  return layout;
}

// The bytes of the largest piece that is decoded at once: a row of a plane, or a tile of one. Checks what all
// of them take, which may be far more than the picture has.
absl::StatusOr<size_t> piece_bytes(const TiffInput& input, const TiffLayout& layout,
                                   const ImageLimits& limits) {
  TIFF* const tiff = input.get();
  const uint64_t pieces = layout.tiled ? TIFFNumberOfTiles(tiff)
                                       : uint64_t{layout.height} * (layout.separate ? layout.samples : 1);
  const uint64_t bytes = layout.tiled ? TIFFTileSize64(tiff) : TIFFScanlineSize64(tiff);
  if (pieces == 0 || bytes == 0) return input.damaged();
  const uint64_t most_in_all = limits.max_bytes + limits.max_chunk_bytes;
  if (bytes > limits.max_chunk_bytes || bytes > most_in_all / pieces) {
    return absl::ResourceExhaustedError(absl::StrFormat(
        "%s: its samples are %d %s of %d bytes; the limits are %d bytes for one and %d for all, so save it "
        "%s",
        input.path(), pieces, layout.tiled ? "tiles" : "rows", bytes, limits.max_chunk_bytes, most_in_all,
        layout.tiled ? "with smaller tiles" : "without other samples than colours and alpha"));
  }
  return static_cast<size_t>(bytes);
}

// The signal by the file's ICC profile, else by the primaries that its own tags name.
Signal signal_of_tiff(TIFF* tiff, const TiffLayout& layout, std::vector<std::string>& notes) {
  Signal signal{.inks = layout.colors == 4};
  uint32_t size = 0;
  const void* profile = nullptr;
  if (TIFFGetField(tiff, TIFFTAG_ICCPROFILE, &size, &profile) != 0) {
    const int components = layout.photometric == PHOTOMETRIC_PALETTE ? 3 : layout.colors;
    take_profile(kIccSource, {static_cast<const char*>(profile), size}, components, signal, notes);
    return signal;
  }
  const float *primaries = nullptr, *white = nullptr;
  if (TIFFGetField(tiff, TIFFTAG_PRIMARYCHROMATICITIES, &primaries) != 0 &&
      TIFFGetField(tiff, TIFFTAG_WHITEPOINT, &white) != 0) {
    std::copy_n(primaries, 6, signal.xy.begin());
    std::copy_n(white, 2, signal.xy.begin() + 6);
    signal.source = "PrimaryChromaticities";
  }
  return signal;
}

// The width of a stored pixel over its height; 0 if the file does not say it.
double stored_aspect_of(TIFF* tiff) {
  const auto across = field<float>(tiff, TIFFTAG_XRESOLUTION), down = field<float>(tiff, TIFFTAG_YRESOLUTION);
  return across > 0 && down > 0 ? static_cast<double>(down) / across : 0;
}

// ---- The samples ----

// Puts samples where their pixels will be, upright. Until a pixel is decoded, its 16 bytes in the image hold
// its samples as they are in the file, the colours and then alpha: as eight codes or as four floats.
class TiffSamples {
 public:
  TiffSamples(const TiffLayout& layout, const Turned& turned, Image& image)
      : layout_(layout), turned_(turned), image_(image), slots_(layout.samples, kUnused) {
    for (uint16_t i = 0; i < layout.colors; ++i) slots_[i] = i;
    if (layout.alpha) slots_[*layout.alpha] = layout.colors;
  }

  bool uses(uint16_t sample) const { return slots_[sample] != kUnused; }
  uint16_t planes() const { return layout_.separate ? layout_.samples : 1; }

  // Takes pixels of a row of the file, from x, y on.
  void take(const std::byte* row, uint32_t x, uint32_t y, uint32_t pixels, uint16_t plane) {
    const size_t stride = layout_.separate ? 1 : layout_.samples;
    if (layout_.floats) {
      floats_.resize(pixels * stride);
      to_floats(row);
      place(floats_, stride, x, y, plane);
    } else {
      codes_.resize(pixels * stride);
      to_codes(row);
      place(codes_, stride, x, y, plane);
    }
  }

  // Makes pixels count as absent.
  void lose(uint32_t x, uint32_t y, uint32_t width, uint32_t height) {
    absent_.resize(size_t{image_.width} * image_.height);
    for (uint32_t i = 0; i < height; ++i) {
      for (uint32_t k = 0; k < width; ++k) {
        const auto [to_x, to_y] = turned_.place(x + k, y + i);
        absent_[size_t{to_y} * image_.width + to_x] = true;
      }
    }
  }

  // Clears the lost pixels, after all are decoded. Returns how many they are.
  uint64_t clear_lost() {
    uint64_t lost = 0;
    for (size_t i = 0; i < absent_.size(); ++i) {
      if (!absent_[i]) continue;
      std::memset(image_.pixels.data() + kPixelBytes * i, 0, kPixelBytes);
      ++lost;
    }
    return lost;
  }

 private:
  static constexpr uint16_t kUnused = 0xffff;

  void to_floats(const std::byte* row) {
    if (layout_.bits == 32) {
      std::memcpy(floats_.data(), row, floats_.size() * sizeof(float));
      return;
    }
    for (size_t i = 0; i < floats_.size(); ++i) {
      uint16_t half;
      std::memcpy(&half, row + i * sizeof half, sizeof half);
      floats_[i] = imath_half_to_float(half);
    }
  }

  void to_codes(const std::byte* row) {
    if (layout_.bits == 16) {
      std::memcpy(codes_.data(), row, codes_.size() * sizeof(uint16_t));
      return;
    }
    // Other ones follow each other without gaps, their highest bits first.
    uint32_t held = 0;
    int bits = 0;
    for (uint16_t& code : codes_) {
      for (; bits < layout_.bits; bits += 8) held = held << 8 | std::to_integer<uint32_t>(*row++);
      bits -= layout_.bits;
      code = static_cast<uint16_t>(held >> bits & ((1u << layout_.bits) - 1));
    }
  }

  template <typename Sample>
  void place(const std::vector<Sample>& samples, size_t stride, uint32_t x, uint32_t y, uint16_t plane) {
    for (size_t i = 0; i < samples.size(); i += stride, ++x) {
      const auto [to_x, to_y] = turned_.is_needed() ? turned_.place(x, y) : std::array{x, y};
      auto* const pixel =
          reinterpret_cast<Sample*>(image_.pixels.data() + to_y * image_.row_bytes() + kPixelBytes * to_x);
      for (size_t s = 0; s < stride; ++s) {
        if (const uint16_t slot = slots_[plane + s]; slot != kUnused) pixel[slot] = samples[i + s];
      }
    }
  }

  const TiffLayout& layout_;
  const Turned& turned_;
  Image& image_;
  std::vector<uint16_t> slots_;  // of each sample of the file: its place in a pixel
  std::vector<float> floats_;    // of a row
  std::vector<uint16_t> codes_;
  std::vector<bool> absent_;  // of each pixel; empty: none is
};

// The three read the samples of all pixels. One that cannot be read is lost; if `goes_on` is false, nothing
// is read after it. They return false if anything is lost.

bool read_strips(TIFF* tiff, const TiffLayout& layout, size_t row_bytes, bool goes_on, TiffSamples& samples) {
  const auto strip_rows = std::max(field<uint32_t>(tiff, TIFFTAG_ROWSPERSTRIP), 1u);
  std::vector<std::byte> row(row_bytes);
  bool whole = true;
  for (uint16_t plane = 0; plane < samples.planes(); ++plane) {
    if (!samples.uses(plane)) continue;
    for (uint32_t y = 0; y < layout.height; ++y) {
      if (TIFFReadScanline(tiff, row.data(), y, plane) == 1) {
        samples.take(row.data(), 0, y, layout.width, plane);
        continue;
      }
      if (!goes_on) return false;
      whole = false;
      const uint32_t rows = std::min(strip_rows - y % strip_rows, layout.height - y);
      samples.lose(0, y, layout.width, rows);
      y += rows - 1;
    }
  }
  return whole;
}

bool read_tiles(TIFF* tiff, const TiffLayout& layout, size_t tile_bytes, bool goes_on, TiffSamples& samples) {
  const auto tile_width = field<uint32_t>(tiff, TIFFTAG_TILEWIDTH);
  const auto tile_height = field<uint32_t>(tiff, TIFFTAG_TILELENGTH);
  const auto row_bytes = static_cast<size_t>(TIFFTileRowSize(tiff));
  std::vector<std::byte> tile(tile_bytes);
  bool whole = true;
  for (uint16_t plane = 0; plane < samples.planes(); ++plane) {
    if (!samples.uses(plane)) continue;
    for (uint32_t y = 0; y < layout.height; y += std::min(tile_height, layout.height - y)) {
      for (uint32_t x = 0; x < layout.width; x += std::min(tile_width, layout.width - x)) {
        const uint32_t width = std::min(tile_width, layout.width - x);
        const uint32_t height = std::min(tile_height, layout.height - y);
        if (TIFFReadTile(tiff, tile.data(), x, y, 0, plane) < 0) {
          if (!goes_on) return false;
          whole = false;
          samples.lose(x, y, width, height);
          continue;
        }
        for (uint32_t i = 0; i < height; ++i) {
          samples.take(tile.data() + i * row_bytes, x, y + i, width, plane);
        }
      }
    }
  }
  return whole;
}

bool read_by_libtiff(TiffInput& input, const TiffLayout& layout, TiffSamples& samples) {
  std::vector<uint32_t> pixels(size_t{layout.width} * layout.height);
  TIFFRGBAImage decoder;
  char error[1024] = "";
  if (TIFFRGBAImageBegin(&decoder, input.get(), 1, error) == 0) {
    input.set_error(error);
    return false;
  }
  decoder.req_orientation = decoder.orientation;  // as stored
  const bool whole = TIFFRGBAImageGet(&decoder, pixels.data(), layout.width, layout.height) != 0;
  TIFFRGBAImageEnd(&decoder);
  for (uint32_t y = 0; whole && y < layout.height; ++y) {
    samples.take(reinterpret_cast<const std::byte*>(&pixels[size_t{y} * layout.width]), 0, y, layout.width,
                 0);
  }
  return whole;
}

// ---- From samples to light ----

// Makes 16-bit codes of R, G, B and straight alpha, or of C, M, Y and K.
class TiffCodes {
 public:
  TiffCodes(TIFF* tiff, const TiffLayout& layout) : layout_(layout), wide_(size_t{1} << layout.bits) {
    const auto top = static_cast<uint32_t>(wide_.size() - 1);
    for (uint32_t i = 0; i <= top; ++i) wide_[i] = static_cast<uint16_t>((i * 65535 + top / 2) / top);
    if (layout.photometric != PHOTOMETRIC_PALETTE) return;
    uint16_t* palette[3] = {};
    TIFFGetField(tiff, TIFFTAG_COLORMAP, &palette[0], &palette[1], &palette[2]);
    for (size_t c = 0; c < 3; ++c) palette_[c].assign(palette[c], palette[c] + wide_.size());
    // Some programs write 8 bits, not 16.
    const bool narrow = std::ranges::all_of(palette_, [](const std::vector<uint16_t>& of) {
      return std::ranges::all_of(of, [](uint16_t code) { return code < 256; });
    });
    for (size_t c = 0; narrow && c < 3; ++c) {
      for (uint16_t& code : palette_[c]) code = static_cast<uint16_t>(code * 257);
    }
  }

  // `samples` are a pixel's, as TiffSamples keeps them.
  void widen(const uint16_t* samples, uint16_t* codes) const {
    const uint16_t a = alpha(samples);
    const size_t colors = layout_.colors == 4 ? 4 : 3;
    if (colors == 3) codes[3] = a;
    for (size_t c = 0; c < colors; ++c) {
      codes[c] = color(samples, c);
      if (!layout_.associated || a == 0) continue;
      codes[c] = static_cast<uint16_t>(std::min((codes[c] * 65535u + a / 2u) / a, 65535u));
    }
  }

  uint16_t alpha(const uint16_t* samples) const {
    return layout_.alpha ? wide_[samples[layout_.colors]] : 65535;
  }

 private:
  uint16_t color(const uint16_t* samples, size_t c) const {
    if (layout_.photometric == PHOTOMETRIC_PALETTE) return palette_[c][samples[0]];
    const uint16_t code = wide_[samples[layout_.colors == 1 ? 0 : c]];
    return layout_.photometric == PHOTOMETRIC_MINISWHITE ? 65535 - code : code;
  }

  const TiffLayout& layout_;
  std::vector<uint16_t> wide_;  // of each code of the file
  std::array<std::vector<uint16_t>, 3> palette_;
};

void decode_codes(TIFF* tiff, const TiffLayout& layout, const SignalDecoder& decoder, Image& image) {
  const TiffCodes wide(tiff, layout);
  std::vector<uint16_t> codes(size_t{4} * image.width);
  std::vector<float> alpha(layout.colors == 4 && layout.alpha ? image.width : 0);  // of inks
  for (uint32_t y = 0; y < image.height; ++y) {
    std::byte* const row = image.pixels.data() + y * image.row_bytes();
    auto* const light = reinterpret_cast<float*>(row);
    for (uint32_t x = 0; x < image.width; ++x) {
      const auto* const samples = reinterpret_cast<const uint16_t*>(row + kPixelBytes * x);
      wide.widen(samples, &codes[size_t{4} * x]);
      if (!alpha.empty()) alpha[x] = static_cast<float>(wide.alpha(samples) / 65535.0);
    }
    decoder.decode(codes, light);
    for (size_t i = 0; i < 4 * alpha.size(); ++i) light[i] *= alpha[i / 4];
  }
}

// Makes R, G, B and associated alpha of floats.
void order_floats(const TiffLayout& layout, Image& image) {
  auto* pixel = reinterpret_cast<float*>(image.pixels.data());
  for (uint64_t i = 0; i < uint64_t{image.width} * image.height; ++i, pixel += 4) {
    const float alpha = layout.alpha ? pixel[layout.colors] : 1;
    if (layout.colors == 1) pixel[1] = pixel[2] = pixel[0];
    for (size_t c = 0; c < 3 && !layout.associated; ++c) pixel[c] *= alpha;
    pixel[3] = alpha;
  }
}

// Makes light of floats by what the file says of them, which is mostly nothing: then they are light.
void decode_floats(const TiffLayout& layout, const Signal& signal, const PictureChoice& choice,
                   Image& image) {
  if (layout.photometric == PHOTOMETRIC_LOGLUV) set_chromaticities(kXyz.xy, image);
  if (signal.transfer == SignalTransfer::kProfile) {
    image.notes.emplace_back("its ICC profile has curves or tables of its own, which are not used of floats");
    return;
  }
  if (signal.source.empty()) return;
  set_chromaticities(signal.xy, image);
  if (signal.source != kIccSource || choice.transfer) return;
  PictureChoice named = choice;
  named.transfer = signal.transfer;
  named.gamma = signal.gamma;
  if (!decodes_values(named)) return;
  image.light = PictureLight::kSdr;
  decode_values(named, image);
  image.signal = absl::StrFormat("floats of %d bits, %s, from %s", layout.bits, name(signal), signal.source);
}

}  // namespace

absl::StatusOr<Image> read_tiff(FileReader& file, const ImageLimits& limits, const PictureChoice& choice) {
  ASSIGN_OR_RETURN(const std::string begin, file.peek(10));
  TiffInput input(file, limits.max_chunk_bytes);
  TIFF* const tiff = input.get();
  if (tiff == nullptr) return input.damaged();
  if (begin.substr(8) == "CR") return camera_raw(input);  // Canon's .cr2
  std::vector<std::string> notes;
  RETURN_IF_ERROR(find_picture(input, notes));
  ASSIGN_OR_RETURN(const TiffLayout layout, layout_of(input, notes));
  const Turned turned(field<uint16_t>(tiff, TIFFTAG_ORIENTATION), layout.width, layout.height);
  RETURN_IF_ERROR(
      check_image_size(file.path(), "image", turned.width(), turned.height(), kTiffFormat, limits));
  ASSIGN_OR_RETURN(const size_t bytes, piece_bytes(input, layout, limits));
  ASSIGN_OR_RETURN(Image image, make_image(turned.width(), turned.height(), kTiffFormat));
  image.has_alpha = layout.alpha.has_value();
  if (const double aspect = stored_aspect_of(tiff); aspect > 0) {
    set_pixel_aspect(turned.swaps() ? 1 / aspect : aspect, image);
  }
  Signal signal = signal_of_tiff(tiff, layout, notes);
  image.notes.insert(image.notes.end(), notes.begin(), notes.end());

  TiffSamples samples(layout, turned, image);
  const bool goes_on = choice.fills_gaps;
  const bool whole = layout.by_libtiff ? read_by_libtiff(input, layout, samples)
                     : layout.tiled    ? read_tiles(tiff, layout, bytes, goes_on, samples)
                                       : read_strips(tiff, layout, bytes, goes_on, samples);
  const absl::Status status = input.damaged();
  if (!whole && layout.by_libtiff) return status;
  if (!whole && !goes_on) return or_fill(status);
  if (layout.floats) {
    order_floats(layout, image);
    decode_floats(layout, signal, choice, image);
  } else {
    const SignalDecoder decoder(std::move(signal), choice);
    decoder.describe(layout.bits, image);
    decode_codes(tiff, layout, decoder, image);
  }
  if (whole) return image;
  const uint64_t missing = samples.clear_lost();
  if (missing == uint64_t{image.width} * image.height) return status;
  note_missing(file.path(), status, missing, image);
  return image;
}

}  // namespace candela
