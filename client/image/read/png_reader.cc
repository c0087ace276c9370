// Reads PNG files by libpng: all of its kinds, as 16 bits of R, G, B and alpha.
//
// cICP says what the codes are, before iCCP, sRGB, and gAMA with cHRM; without any of them they are sRGB. An
// eXIf before the pixels turns the picture. An ancillary chunk with a wrong checksum counts as missing.
#include <png.h>
#include <zlib.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <csetjmp>
#include <cstring>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_format.h"
#include "client/image/read/exif.h"
#include "client/image/read/icc_profile.h"
#include "client/image/read/readers.h"
#include "client/image/read/signal.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

constexpr png_alloc_size_t kMostChunkBytes = 8u << 20;  // of one that is not of pixels
constexpr png_uint_32 kMostChunks = 256;

// libpng reports errors by longjmp. So whatever calls it is a function that has nothing to destroy, and
// returns false for an error.
class Png {
 public:
  explicit Png(FileReader& file) : file_(file) {
    png_ = png_create_read_struct(PNG_LIBPNG_VER_STRING, this, fail, warn);
    if (png_ != nullptr) info_ = png_create_info_struct(png_);
  }
  ~Png() { png_destroy_read_struct(&png_, &info_, nullptr); }
  Png(const Png&) = delete;
  Png& operator=(const Png&) = delete;

  // Reads all before the pixels, and asks for rows of 16-bit R, G, B and alpha.
  bool read_header() {
    if (png_ == nullptr || info_ == nullptr) return false;
    if (setjmp(png_jmpbuf(png_)) != 0) return false;
    png_set_read_fn(png_, this, read);
    png_set_user_limits(png_, PNG_UINT_31_MAX, PNG_UINT_31_MAX);
    png_set_chunk_malloc_max(png_, kMostChunkBytes);
    png_set_chunk_cache_max(png_, kMostChunks);
    png_set_crc_action(png_, PNG_CRC_ERROR_QUIT, PNG_CRC_WARN_DISCARD);
    // libpng does not know the first three, and judges the profile by rules of its own.
    constexpr char kKept[] = "cICP\0cLLI\0mDCV\0iCCP";
    png_set_keep_unknown_chunks(png_, PNG_HANDLE_CHUNK_ALWAYS, reinterpret_cast<png_const_bytep>(kKept), 4);
    png_read_info(png_, info_);
    return true;
  }
  bool begin_rows() {
    if (setjmp(png_jmpbuf(png_)) != 0) return false;
    png_set_expand_16(png_);
    png_set_gray_to_rgb(png_);
    png_set_add_alpha(png_, 0xffff, PNG_FILLER_AFTER);
    if (std::endian::native == std::endian::little) png_set_swap(png_);
    passes_ = png_set_interlace_handling(png_);
    png_read_update_info(png_, info_);
    return png_get_rowbytes(png_, info_) == size_t{8} * width();
  }
  bool read_row(uint16_t* row) {
    if (setjmp(png_jmpbuf(png_)) != 0) return false;
    png_read_row(png_, reinterpret_cast<png_bytep>(row), nullptr);
    return true;
  }

  uint32_t width() const { return png_get_image_width(png_, info_); }
  uint32_t height() const { return png_get_image_height(png_, info_); }
  // Of a component; a palette's have 8.
  int bits() const {
    return png_get_color_type(png_, info_) == PNG_COLOR_TYPE_PALETTE ? 8 : png_get_bit_depth(png_, info_);
  }
  bool is_grey() const { return (png_get_color_type(png_, info_) & PNG_COLOR_MASK_COLOR) == 0; }
  bool has_alpha() const {
    return (png_get_color_type(png_, info_) & PNG_COLOR_MASK_ALPHA) != 0 ||
           png_get_valid(png_, info_, PNG_INFO_tRNS) != 0;
  }
  // The width of a pixel over its height; 0 if the file does not say it.
  double pixel_aspect() const {
    png_uint_32 across = 0, down = 0;  // pixels a unit
    int unit = 0;
    if (png_get_pHYs(png_, info_, &across, &down, &unit) == 0 || across == 0 || down == 0) return 0;
    return static_cast<double>(down) / across;
  }
  // The bytes of eXIf; "" if the file has none before its pixels.
  absl::string_view exif() const {
    png_uint_32 size = 0;
    png_bytep bytes = nullptr;
    if (png_get_eXIf_1(png_, info_, &size, &bytes) == 0) return "";
    return {reinterpret_cast<const char*>(bytes), size};
  }
  // The bytes of a chunk that libpng does not read; nothing if the file has none before its pixels, or its
  // checksum is wrong.
  std::optional<absl::string_view> kept(const std::string& name) const {
    if (damaged_chunks_.contains(name)) return std::nullopt;  // libpng only warns of it
    png_unknown_chunkp chunks = nullptr;
    const int count = png_get_unknown_chunks(png_, info_, &chunks);
    for (int i = 0; i < count; ++i) {
      if (reinterpret_cast<const char*>(chunks[i].name) != name) continue;
      return absl::string_view(reinterpret_cast<const char*>(chunks[i].data), chunks[i].size);
    }
    return std::nullopt;
  }
  int passes() const { return passes_; }
  // The names of chunks about the picture whose checksums are wrong.
  const std::set<std::string>& damaged_chunks() const { return damaged_chunks_; }
  const char* error() const { return error_; }
  png_structp get() const { return png_; }
  png_infop info() const { return info_; }

 private:
  [[noreturn]] static void fail(png_structp png, png_const_charp message) {
    Png& self = *static_cast<Png*>(png_get_error_ptr(png));
    std::strncpy(self.error_, message, sizeof self.error_ - 1);
    png_longjmp(png, 1);
  }
  // The message begins with the chunk's name: "gAMA: CRC error". Texts and times say nothing of the picture.
  static void warn(png_structp png, png_const_charp message) {
    Png& self = *static_cast<Png*>(png_get_error_ptr(png));
    if (!absl::StrContains(message, ": CRC error")) return;
    for (const char* name :
         {"cHRM", "cICP", "cLLI", "eXIf", "gAMA", "iCCP", "mDCV", "pHYs", "sRGB", "tRNS"}) {
      if (absl::StartsWith(message, name)) self.damaged_chunks_.insert(name);
    }
  }
  static void read(png_structp png, png_bytep to, size_t bytes) {
    Png& self = *static_cast<Png*>(png_get_io_ptr(png));
    if (!self.file_.read({reinterpret_cast<std::byte*>(to), bytes})) png_error(png, "the file is truncated");
  }

  FileReader& file_;
  png_structp png_ = nullptr;
  png_infop info_ = nullptr;
  int passes_ = 1;
  char error_[128] = "libpng cannot start";
  std::set<std::string> damaged_chunks_;
};

absl::Status damaged_png(const FileReader& file, const Png& png) {
  return absl::InvalidArgumentError(
      absl::StrFormat("%s: damaged PNG file: %s", file.path(), printable(png.error(), 100)));
}

// What a cICP chunk says. Source: PNG, third edition; ITU-T H.273.
struct CodePointChunk {
  int primaries = kUnspecifiedCode, transfer = kUnspecifiedCode;
  bool is_full = true;
};

// That of the file. One that PNG does not allow is not used, with a note.
CodePointChunk code_points_of(const Png& png, std::vector<std::string>& notes) {
  const std::optional<absl::string_view> chunk = png.kept("cICP");
  if (!chunk) return {};
  if (chunk->size() != 4) {
    notes.push_back(absl::StrFormat("its cICP is not used: it has %d bytes, and must have 4", chunk->size()));
    return {};
  }
  const auto byte = [&](size_t i) { return int{static_cast<uint8_t>((*chunk)[i])}; };
  if (byte(2) != 0 || byte(3) > 1) {
    notes.push_back(absl::StrFormat(
        "its cICP is not used: it has matrix %d and range %d; a PNG has matrix 0 (RGB) and range 0 or 1",
        byte(2), byte(3)));
    return {};
  }
  return {byte(0), byte(1), byte(3) == 1};
}

// The profile in an iCCP chunk: a label, 0, the method 0, and what zlib packed. "" if it is damaged. A
// profile begins with its size.
std::string profile_of(absl::string_view chunk) {
  constexpr uint32_t kMost = 8u << 20;
  const size_t label = chunk.find('\0');
  if (label == chunk.npos || chunk.size() < label + 2 || chunk[label + 1] != 0) return "";
  const absl::string_view packed = chunk.substr(label + 2);
  const auto unpack = [&packed](size_t size) {
    std::string bytes(size, '\0');
    uLongf got = size;
    const int result = uncompress(reinterpret_cast<Bytef*>(bytes.data()), &got,
                                  reinterpret_cast<const Bytef*>(packed.data()), packed.size());
    bytes.resize(result == Z_OK || result == Z_BUF_ERROR ? got : 0);
    return bytes;
  };
  const uint32_t size = big_endian_at(unpack(4), 0);
  return size > kMost ? "" : unpack(size);
}

void take_gamma(const Png& png, Signal& signal, std::vector<std::string>& notes) {
  double gamma = 0;
  if (png_get_gAMA(png.get(), png.info(), &gamma) != 0) {
    if (gamma >= 0.1 && gamma <= 2) {
      signal.transfer = gamma == 1 ? SignalTransfer::kLinear : SignalTransfer::kGamma;
      signal.gamma = 1 / gamma;
      signal.source = "gAMA";
    } else {
      notes.push_back(absl::StrFormat("gAMA of %g is not within 0.1 .. 2 and was ignored", gamma));
    }
  }
  std::array<double, 8> xy{};
  if (png_get_cHRM(png.get(), png.info(), &xy[6], &xy[7], &xy[0], &xy[1], &xy[2], &xy[3], &xy[4], &xy[5]) !=
      0) {
    for (size_t i = 0; i < xy.size(); ++i) signal.xy[i] = static_cast<float>(xy[i]);
    if (signal.source.empty()) signal.source = "cHRM";
  }
}

double max_light_of(const Png& png) {
  constexpr double kUnit = 1e-4;
  constexpr size_t kMasteringAt = 16;  // behind the display's primaries and white
  return max_light(kUnit * big_endian_at(png.kept("cLLI").value_or(""), 0),
                   kUnit * big_endian_at(png.kept("mDCV").value_or(""), kMasteringAt));
}

absl::StatusOr<Signal> signal_of_png(const FileReader& file, const Png& png, const CodePointChunk& code,
                                     const PictureChoice& choice, std::vector<std::string>& notes) {
  Signal signal;
  const bool names_transfer = code.transfer != kUnspecifiedCode;
  const bool names_primaries = code.primaries != kUnspecifiedCode;
  if (!names_transfer || !names_primaries) {
    const std::optional<absl::string_view> profile = png.kept("iCCP");
    if (profile) take_profile("iCCP", profile_of(*profile), png.is_grey() ? 1 : 3, signal, notes);
    int intent = 0;
    if (signal.source.empty() && png_get_sRGB(png.get(), png.info(), &intent) != 0) {
      constexpr int kRec709Code = 1, kSrgbCode = 13;
      RETURN_IF_ERROR(set_code_points(file.path(), "sRGB", kRec709Code, kSrgbCode, choice, signal));
    }
    if (signal.source.empty()) take_gamma(png, signal, notes);
    if (signal.source.empty() && is_adobe_rgb(png.exif())) set_adobe_rgb(signal);
  }
  if (names_transfer || names_primaries) {
    RETURN_IF_ERROR(set_code_points(file.path(), "cICP", code.primaries, code.transfer, choice, signal));
  }
  signal.max_light_nits = max_light_of(png);
  return signal;
}

// Stretches codes of limited range, 16 .. 235 of 8 bits, to all of 0 .. 65535. Alpha has the full range.
void stretch(int bits, std::span<uint16_t> codes) {
  const double most = (1 << bits) - 1, step = std::ldexp(1.0, bits - 8);
  for (size_t i = 0; i < codes.size(); ++i) {
    if (i % 4 == 3) continue;
    const double signal = (codes[i] / 65535.0 * most / step - 16) / 219;
    codes[i] = static_cast<uint16_t>(std::clamp(signal, 0.0, 1.0) * 65535 + 0.5);
  }
}

// Rows until one cannot be read. Returns how many.
uint32_t read_rows(Png& png, const SignalDecoder& decoder, bool full_range, int bits, const Turned& turned,
                   Image& image) {
  const uint32_t height = png.height();
  const size_t row_codes = size_t{4} * png.width();
  // The pixels of an interlaced file come seven times.
  std::vector<uint16_t> codes(row_codes * (png.passes() > 1 ? height : 1));
  std::vector<float> light(row_codes);
  for (int pass = 1; pass < png.passes(); ++pass) {
    for (uint32_t y = 0; y < height; ++y) {
      if (!png.read_row(codes.data() + y * row_codes)) return 0;
    }
  }
  for (uint32_t y = 0; y < height; ++y) {
    uint16_t* const row = codes.data() + (png.passes() > 1 ? y * row_codes : 0);
    if (!png.read_row(row)) return png.passes() > 1 ? 0 : y;
    if (!full_range) stretch(bits, {row, row_codes});
    decoder.decode({row, row_codes}, light.data());
    turned.put_row(light, y, image);
  }
  return height;
}

}  // namespace

absl::StatusOr<Image> read_png(FileReader& file, const ImageLimits& limits, const PictureChoice& choice) {
  Png png(file);
  if (!png.read_header()) return damaged_png(file, png);
  constexpr ImageFormat kFormat = ImageFormat::kRgba32f;
  const Turned turned(orientation_of(png.exif()), png.width(), png.height());
  RETURN_IF_ERROR(check_image_size(file.path(), "image", turned.width(), turned.height(), kFormat, limits));
  std::vector<std::string> notes;
  const CodePointChunk code = code_points_of(png, notes);
  ASSIGN_OR_RETURN(Signal signal, signal_of_png(file, png, code, choice, notes));
  for (const std::string& name : png.damaged_chunks()) {
    notes.push_back(absl::StrFormat("its %s has a wrong checksum and is not used", name));
  }
  const int bits = png.bits();
  const bool has_alpha = png.has_alpha();
  const double pixel_aspect = png.pixel_aspect();
  if (!png.begin_rows()) return damaged_png(file, png);
  ASSIGN_OR_RETURN(Image image, make_image(turned.width(), turned.height(), kFormat));
  image.has_alpha = has_alpha;
  if (pixel_aspect > 0) set_pixel_aspect(turned.swaps() ? 1 / pixel_aspect : pixel_aspect, image);
  image.notes.insert(image.notes.end(), notes.begin(), notes.end());
  const SignalDecoder decoder(std::move(signal), choice);
  decoder.describe(bits, image);
  const bool full_range = choice.full_range.value_or(code.is_full);
  const uint32_t rows = read_rows(png, decoder, full_range, bits, turned, image);
  if (rows == png.height()) return image;
  const absl::Status status = damaged_png(file, png);
  if (rows == 0) return status;
  if (!choice.fills_gaps) return or_fill(status);
  note_missing(file.path(), status, uint64_t{png.height() - rows} * png.width(), image);
  return image;
}

}  // namespace candela
