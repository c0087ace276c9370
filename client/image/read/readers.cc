#include "client/image/read/readers.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/strip.h"
#include "client/base/number_words.h"
#include "client/image/color.h"
#include "client/image/read_formats.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

// Whether the primaries span a plane and can be mixed to white.
bool has_matrix(const std::array<float, 8>& xy) {
  for (float v : xy) {
    // Real encodings, even with imaginary primaries, stay within a few units.
    if (!std::isfinite(v) || std::fabs(v) > 1e3f) return false;
  }
  const auto cross = [&](int a, int b, int c) {  // twice the area of the triangle a b c
    const double ax = xy[2 * a], ay = xy[2 * a + 1];
    return (xy[2 * b] - ax) * (xy[2 * c + 1] - ay) - (xy[2 * c] - ax) * (xy[2 * b + 1] - ay);
  };
  constexpr int kRed = 0, kGreen = 1, kBlue = 2, kWhite = 3;
  constexpr double kTiny = 1e-6;
  return std::fabs(cross(kRed, kGreen, kBlue)) > kTiny && std::fabs(xy[7]) > kTiny &&
         // If white is on a side of the triangle, one primary has no share in it.
         std::fabs(cross(kWhite, kGreen, kBlue)) > kTiny && std::fabs(cross(kRed, kWhite, kBlue)) > kTiny &&
         std::fabs(cross(kRed, kGreen, kWhite)) > kTiny;
}

// Characters that end lines, hide themselves or turn the direction of the text around them.
bool is_control(uint32_t code) {
  constexpr struct {
    uint32_t first, last;
  } kControls[] = {{0x80, 0x9f},     {0xad, 0xad},      {0x061c, 0x061c}, {0x180e, 0x180e},
                   {0x200b, 0x200f}, {0x2028, 0x202e},  {0x2060, 0x206f}, {0xfeff, 0xfeff},
                   {0xfff9, 0xfffb}, {0xe0000, 0xe007f}};
  for (const auto& range : kControls) {
    if (code >= range.first && code <= range.last) return true;
  }
  return false;
}

// The bytes of the text's first character; 0 if it is not UTF-8 or cannot be printed. `text` is not empty.
size_t printable_bytes(absl::string_view text) {
  const auto byte = [&](size_t i) { return static_cast<unsigned char>(text[i]); };
  if (byte(0) < 0x80) return absl::ascii_isprint(byte(0)) ? 1 : 0;
  if (byte(0) < 0xc2 || byte(0) > 0xf4) return 0;
  const size_t bytes = byte(0) >= 0xf0 ? 4 : byte(0) >= 0xe0 ? 3 : 2;
  if (text.size() < bytes) return 0;
  uint32_t code = byte(0) & (0x7fu >> bytes);
  for (size_t i = 1; i < bytes; ++i) {
    if ((byte(i) & 0xc0) != 0x80) return 0;
    code = code << 6 | (byte(i) & 0x3fu);
  }
  constexpr uint32_t kLeast[] = {0, 0, 0x80, 0x800, 0x10000};
  const bool surrogate = code >= 0xd800 && code <= 0xdfff;
  return code < kLeast[bytes] || code > 0x10ffff || surrogate || is_control(code) ? 0 : bytes;
}

// Text may stand before the line that names the kind: Radiance's own programs look for its FORMAT alone.
bool is_radiance(absl::string_view head) {
  if (absl::StartsWith(head, "#?")) return true;
  const size_t at =
      std::min({head.find("\n#?RADIANCE"), head.find("\n#?RGBE"), head.find("\nFORMAT=32-bit_rle_"),
                absl::StartsWith(head, "FORMAT=32-bit_rle_") ? 0 : head.npos});
  return at != head.npos && std::ranges::all_of(head.substr(0, at), [](unsigned char c) {
           return absl::ascii_isprint(c) || absl::ascii_isspace(c) || c >= 0x80;
         });
}

// Pictures of kinds that are not read, by bytes at a place of their beginning.
constexpr struct {
  const char* name;
  size_t at;
  absl::string_view bytes;
} kOthers[] = {{"JPEG 2000", 0, {"\0\0\0\x0cjP  ", 8}},
               {"JPEG 2000", 0, "\xff\x4f\xff\x51"},
               {"JPEG XL", 0, {"\0\0\0\x0cJXL ", 8}},
               {"JPEG XL", 0, "\xff\x0a"},
               {"WebP", 8, "WEBP"},
               {"HEIC", 4, "ftypheic"},
               {"HEIC", 4, "ftypheix"}};

}  // namespace

absl::StatusOr<FileKind> file_kind(FileReader& file) {
  ASSIGN_OR_RETURN(const std::string head, file.peek(256));
  const std::string begin = head.substr(0, 12);
  const absl::string_view magic = absl::string_view(begin).substr(0, 4);
  if (magic == "\x76\x2f\x31\x01") return FileKind::kExr;
  if (is_radiance(head)) return FileKind::kRadiance;
  for (const char* pfm : {"PF", "Pf", "PH", "Ph"}) {
    if (absl::StartsWith(magic, pfm)) return FileKind::kPfm;
  }
  if (magic == "\x89PNG") return FileKind::kPng;
  if (absl::StartsWith(magic, "\xff\xd8\xff")) return FileKind::kJpeg;
  for (const char* tiff : {"II*\0", "MM\0*", "II+\0", "MM\0+"}) {
    if (magic == absl::string_view(tiff, 4)) return FileKind::kTiff;
  }
  if (const std::string brand = begin.size() < 12 ? "" : begin.substr(4);
      brand == "ftypavif" || brand == "ftypavis" || brand == "ftypmif1") {
    return FileKind::kAvif;
  }
  for (const auto& [kind, at, bytes] : kOthers) {
    if (begin.size() < at || !absl::StartsWith(begin.substr(at), bytes)) continue;
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: Candela does not read %s; convert it to PNG or AVIF", file.path(), kind));
  }
  if (magic.empty()) return absl::InvalidArgumentError(absl::StrFormat("%s: the file is empty", file.path()));
  return absl::InvalidArgumentError(absl::StrFormat("%s: not an %s file", file.path(), read_format_names()));
}

absl::Status check_image_size(const std::string& path, const char* what, int64_t width, int64_t height,
                              ImageFormat format, const ImageLimits& limits) {
  if (width < 1 || height < 1) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: the %s is %dx%d pixels; it must be at least 1x1", path, what, width, height));
  }
  if (width > limits.max_dimension || height > limits.max_dimension) {
    return absl::ResourceExhaustedError(
        absl::StrFormat("%s: the %s is %dx%d pixels; the limit is %d on a side, so crop it or scale it down",
                        path, what, width, height, limits.max_dimension));
  }
  if (limits.max_pixels > 0 &&
      static_cast<uint64_t>(width) * static_cast<uint64_t>(height) > limits.max_pixels) {
    return absl::ResourceExhaustedError(
        absl::StrFormat("%s: the %s is %dx%d, %d pixels; --max-pixels allows %d", path, what, width, height,
                        width * height, limits.max_pixels));
  }
  // Divides, because a product might overflow 64 bits.
  const uint32_t pixel_bytes = bytes_per_pixel(format);
  if (static_cast<uint64_t>(height) > limits.max_bytes / (static_cast<uint64_t>(width) * pixel_bytes)) {
    return absl::ResourceExhaustedError(absl::StrFormat(
        "%s: the %s is %dx%d pixels of %d bytes; the limit is %d bytes, so save it %s, or start a "
        "candelad with a larger --max-frame-bytes and name it with --server",
        path, what, width, height, pixel_bytes, limits.max_bytes,
        format == ImageFormat::kRgba32f ? "as half floats or smaller" : "smaller"));
  }
  return absl::OkStatus();
}

absl::Status or_fill(const absl::Status& status) {
  return {status.code(), absl::StrCat(status.message(), "; --incomplete fill renders what is there")};
}

void note_missing(const std::string& path, const absl::Status& why, uint64_t missing, Image& image) {
  image.notes.push_back(absl::StrFormat("%s: %d of its %d pixels are missing and absent, with alpha 0",
                                        absl::StripPrefix(why.message(), path + ": "), missing,
                                        uint64_t{image.width} * image.height));
  image.missing_pixels = missing;
  image.has_alpha = true;
}

uint32_t big_endian_at(absl::string_view bytes, uint64_t at, size_t size) {
  if (at > bytes.size() || size > bytes.size() - at) return 0;
  uint32_t number = 0;
  for (size_t i = 0; i < size; ++i) number = number << 8 | static_cast<unsigned char>(bytes[at + i]);
  return number;
}

void set_chromaticities(const std::array<float, 8>& xy, Image& image) {
  image.chromaticities.reset();
  if (!has_matrix(xy)) {
    image.notes.push_back(
        "the file's chromaticities are singular and were ignored; its colours are taken as Rec.709");
    return;
  }
  image.names_primaries = true;
  const bool rec709 = std::equal(xy.begin(), xy.end(), kRec709.xy.begin(),
                                 [](float a, float b) { return std::fabs(a - b) <= 1e-4f; });
  if (!rec709) image.chromaticities = xy;
}

void set_pixel_aspect(double aspect, Image& image) {
  if (std::isfinite(aspect) && aspect >= 0.01 && aspect <= 100) {
    image.pixel_aspect = aspect;
  } else {
    image.notes.push_back(absl::StrFormat(
        "the file's pixel aspect of %s is not within 0.01 .. 100 and was ignored", in_digits(aspect, 6)));
  }
}

std::string printable(absl::string_view text, size_t most) {
  std::string result;
  for (size_t i = 0; i < text.size() && i < most;) {
    const size_t bytes = printable_bytes(text.substr(i));
    if (bytes > 0) {
      absl::StrAppend(&result, text.substr(i, bytes));
    } else {
      absl::StrAppendFormat(&result, "\\x%02x", static_cast<unsigned char>(text[i]));
    }
    i += bytes > 0 ? bytes : 1;
  }
  return result;
}

}  // namespace candela
