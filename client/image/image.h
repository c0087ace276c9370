// Image files in and out: OpenEXR, Radiance .hdr and PFM come in; PNG, JPEG, OpenEXR and PFM go out. No
// network, no device. Every function here may be called from any thread, on different images at once; OpenEXR
// decodes with the threads that Imf::setGlobalThreadCount gave it (the caller's choice; none by default).
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client/image/pixel_buffer.h"
#include "server/encode/picture.h"

namespace candela {

// Four interleaved components, red first, little endian, rows tight and from the top. The integer ones are
// what a server renders to, never what a file is read to.
enum class ImageFormat { kRgba16f, kRgba32f, kRgba8, kRgba16 };

constexpr uint32_t bytes_per_pixel(ImageFormat format) {
  return format == ImageFormat::kRgba8 ? 4 : format == ImageFormat::kRgba32f ? 16 : 8;
}

const char* name(ImageFormat format);  // "rgba16f"

struct Image {
  uint32_t width = 0;
  uint32_t height = 0;
  ImageFormat format = ImageFormat::kRgba16f;
  PixelBuffer pixels;         // bytes() of them
  bool has_alpha = false;     // false: every alpha is 1 and says nothing
  double pixel_aspect = 1.0;  // width / height of one pixel
  // CIE 1931 xy of red, green, blue and white: rx ry gx gy bx by wx wy. Absent: Rec.709, D65.
  std::optional<std::array<float, 8>> chromaticities;
  std::vector<std::string> notes;  // what the user should hear: "EXPOSURE 0.5 divided out"

  uint64_t row_bytes() const { return uint64_t{width} * bytes_per_pixel(format); }
  uint64_t bytes() const { return row_bytes() * height; }
};

// An image of zeros. RESOURCE_EXHAUSTED when there is not so much memory.
absl::StatusOr<Image> make_image(uint32_t width, uint32_t height, ImageFormat format);

// What a reader accepts, checked from the file's header alone, before pixel memory is taken. The dimension
// also holds for the part of the picture that an OpenEXR file stores (its data window).
struct ImageLimits {
  uint32_t max_dimension = 16384;  // width or height, in pixels
  uint64_t max_bytes = 1u << 29;   // of the pixels in the format that the file is read to
  // OpenEXR decodes whole chunks (some rows, or a tile) of all channels, several at once; a header may ask
  // for chunks of any size.
  uint64_t max_chunk_bytes = 256u << 20;
};

// Reads an OpenEXR, Radiance or PFM file, known by its first bytes, not by its name. Half-float files come as
// kRgba16f, all others as kRgba32f; values are the file's own (see exr_reader.cc and radiance_reader.cc for
// what is decided where a file leaves room). Errors name the file and what is wrong: NOT_FOUND,
// PERMISSION_DENIED, INVALID_ARGUMENT (not an image, damaged, nothing to render), RESOURCE_EXHAUSTED (beyond
// the limits), UNIMPLEMENTED (deep images).
absl::StatusOr<Image> read_image(const std::string& path, const ImageLimits& limits = {});

enum class OutputKind { kPng, kJpeg, kExr, kPfm };

// By extension, upper or lower case. INVALID_ARGUMENT for another one, listing those there are.
absl::StatusOr<OutputKind> output_kind(const std::string& path);

// As output_kind, and also finds out early, without writing, that the folder is missing or closed to us or
// that the path is a folder, a FIFO or a device: for calling before minutes of rendering.
absl::StatusOr<OutputKind> check_output_path(const std::string& path);

struct WriteOptions {
  // How the integer formats were encoded; written into a PNG (sRGB or gAMA chunk; nothing where it is
  // unknown).
  EncodedTransfer transfer = EncodedTransfer::kSrgb;
  int jpeg_quality = 92;  // 1..100
  // Keyword (1..79 characters) and text, both Latin-1, of a PNG's tEXt chunks; other formats take none.
  std::vector<std::pair<std::string, std::string>> text = {};
};

// Writes the image by the path's extension: .png from kRgba8 or kRgba16, .jpg from kRgba8, .exr and .pfm from
// kRgba16f or kRgba32f. Alpha is stored as it is and colour is not divided by it; formats without alpha drop
// it. The file appears whole or not at all: a failure leaves what was there before. It keeps the
// permissions of a file that it replaces, and a link goes on pointing at it. Returns what the user should
// hear
// ("alpha dropped: .jpg has none"), often nothing.
absl::StatusOr<std::vector<std::string>> write_image(const std::string& path, const Image& image,
                                                     const WriteOptions& options = {});

}  // namespace candela
