// The table of encodings, and how an image or a file of a server is written by one of its rows.
// What a server encodes knows no pixel aspect; write_with_aspect() adds it.
#include "client/image/write/encodings.h"

#include <zlib.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "absl/functional/function_ref.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "client/base/failure.h"
#include "client/image/color.h"
#include "client/image/read_formats.h"
#include "client/image/write/atomic_file.h"
#include "client/image/write/writers.h"
#include "server/base/status_macros.h"
#include "server/encode/color_words.h"
#include "server/encode/gain_map.h"

namespace candela {
namespace {

constexpr size_t kPngSignature = 8;
constexpr size_t kChunkFrame = 12;  // length, kind and checksum
// A JPEG's first bytes: SOI, APP0 and its length, "JFIF\0", version, unit, density across, density down.
constexpr size_t kJfifKind = 6;
constexpr size_t kJfifUnit = 13;
constexpr size_t kJfifEnd = 18;

std::string_view text_of(std::span<const std::byte> bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

uint32_t big_endian(std::string_view bytes) {
  uint32_t value = 0;
  for (size_t i = 0; i < 4; ++i) value = value << 8 | static_cast<unsigned char>(bytes[i]);
  return value;
}

std::string to_big_endian(uint32_t value, int bytes) {
  std::string text;
  for (int i = bytes - 1; i >= 0; --i) text += static_cast<char>(value >> (8 * i));
  return text;
}

// The offset of the first IDAT chunk; npos if there is none, or a pHYs chunk before it.
size_t pixels_in_png(std::string_view png) {
  size_t at = kPngSignature;
  while (png.size() >= kChunkFrame && at <= png.size() - kChunkFrame) {
    const std::string_view kind = png.substr(at + 4, 4);
    if (kind == "IDAT") return at;
    if (kind == "pHYs") break;
    at += kChunkFrame + big_endian(png.substr(at, 4));
  }
  return std::string_view::npos;
}

// Pixels per unit, where the unit has no size. Wider pixels mean fewer of them.
std::string phys_chunk(AspectRatio aspect) {
  const std::string body =
      "pHYs" + to_big_endian(aspect.height, 4) + to_big_endian(aspect.width, 4) + std::string(1, '\0');
  const uLong checksum =
      crc32(0, reinterpret_cast<const Bytef*>(body.data()), static_cast<uInt>(body.size()));
  return to_big_endian(static_cast<uint32_t>(body.size() - 4), 4) + body +
         to_big_endian(static_cast<uint32_t>(checksum), 4);
}

}  // namespace

void write_with_aspect(AtomicFile& file, std::span<const std::byte> encoded, double pixel_aspect) {
  const AspectRatio aspect = aspect_ratio(pixel_aspect);
  const std::string_view bytes = text_of(encoded);
  size_t keep = 0, skip = 0;  // bytes before the change, and bytes that it replaces
  std::string change;
  if (aspect.width == aspect.height) {
    // Square, as the server wrote it.
  } else if (bytes.size() > kPngSignature && bytes.substr(1, 3) == "PNG") {
    const size_t at = pixels_in_png(bytes);
    if (at != std::string_view::npos) keep = at, change = phys_chunk(aspect);
  } else if (bytes.size() > kJfifEnd && bytes.substr(kJfifKind, 5) == std::string_view("JFIF\0", 5)) {
    keep = kJfifUnit;
    change = std::string(1, '\0') + to_big_endian(aspect.height, 2) + to_big_endian(aspect.width, 2);
    skip = change.size();
  }
  file.write(bytes.data(), keep);
  file.write(change.data(), change.size());
  file.write(bytes.data() + keep + skip, bytes.size() - keep - skip);
}

std::string profile_of_primaries(const WriteOptions& options) {
  if (!options.primaries || is_hdr(options.transfer) || options.transfer == EncodedTransfer::kUnknown)
    return "";
  const NamedPrimaries* const known = find_primaries(*options.primaries);
  return icc_profile(options.transfer, *options.primaries,
                     known != nullptr ? known->known_as : "a picture's RGB");
}

namespace {

// A view for the encoders of an image in kRgba8 or kRgba16.
PictureView picture_of(const Image& image) {
  const AspectRatio aspect = aspect_ratio(image.pixel_aspect);
  return {.width = image.width,
          .height = image.height,
          .wide = image.format == ImageFormat::kRgba16,
          .rows = image.pixels.data(),
          .row_stride_bytes = image.row_bytes(),
          .aspect_width = aspect.width,
          .aspect_height = aspect.height};
}

absl::Status write_png(AtomicFile& file, const Image& image, const WriteOptions& options, Notes&) {
  return encode_png(
      picture_of(image),
      {image.has_alpha, options.transfer, options.hdr, profile_of_primaries(options), options.text},
      [&file](const void* bytes, size_t count) { return file.write(bytes, count); });
}

absl::Status write_jpeg(AtomicFile& file, const Image& image, const WriteOptions& options, Notes&) {
  const PictureView picture = picture_of(image);
  const std::optional<GainMapCodes> in_alpha = gain_map_in_alpha(picture, options.gain_map_max_log2);
  const GainMapCodes* const map = in_alpha ? &*in_alpha : options.gain_map.get();
  return encode_jpeg(picture, {options.jpeg_quality, options.transfer, profile_of_primaries(options), map},
                     [&file](const void* bytes, size_t count) { return file.write(bytes, count); });
}

const OutputEncoding kEncodings[] = {
    {.name = "PNG",
     .extensions = {".png"},
     .formats = {ImageFormat::kRgba8, ImageFormat::kRgba16},
     .alpha = v1::ALPHA_STRAIGHT,
     .server = v1::ENCODING_PNG,
     .lossy = false,
     .hdr = true,
     .write = write_png},
    {.name = "JPEG",
     .extensions = {".jpg", ".jpeg"},
     .formats = {ImageFormat::kRgba8},
     .alpha = v1::ALPHA_UNSPECIFIED,
     .server = v1::ENCODING_JPEG,
     .lossy = true,
     .hdr = false,
     .write = write_jpeg},
    {.name = "TIFF",
     .extensions = {".tif", ".tiff"},
     .formats = {ImageFormat::kRgba8, ImageFormat::kRgba16},
     .alpha = v1::ALPHA_STRAIGHT,
     .server = v1::ENCODING_RAW,
     .lossy = false,
     .hdr = false,
     .write = write_tiff},
    {.name = "AVIF",
     .extensions = {".avif"},
     .formats = {ImageFormat::kRgba16},
     .alpha = v1::ALPHA_STRAIGHT,
     .server = v1::ENCODING_RAW,
     .lossy = true,
     .hdr = true,
     .write = write_avif},
    {.name = "OpenEXR",
     .extensions = {".exr"},
     .formats = {ImageFormat::kRgba16f, ImageFormat::kRgba32f},
     .alpha = v1::ALPHA_ASSOCIATED,
     .server = v1::ENCODING_RAW,
     .lossy = false,
     .hdr = false,
     .write = write_exr},
    {.name = "PFM",
     .extensions = {".pfm"},
     .formats = {ImageFormat::kRgba16f, ImageFormat::kRgba32f},
     .alpha = v1::ALPHA_UNSPECIFIED,
     .server = v1::ENCODING_RAW,
     .lossy = false,
     .hdr = false,
     .write = write_pfm},
};

std::string every_extension() {
  std::vector<std::string> all;
  for (const OutputEncoding& encoding : kEncodings) {
    all.insert(all.end(), encoding.extensions.begin(), encoding.extensions.end());
  }
  return one_of(std::move(all));
}

absl::Status check_image(const OutputEncoding& encoding, const Image& image) {
  if (image.width == 0 || image.height == 0 || image.pixels.size() != image.bytes()) {
    return absl::InvalidArgumentError(absl::StrFormat("a %dx%d %s image has %d bytes, this one has %d",
                                                      image.width, image.height, name(image.format),
                                                      image.bytes(), image.pixels.size()));
  }
  if (std::ranges::count(encoding.formats, image.format) > 0) return absl::OkStatus();
  const auto names = [](std::string* out, ImageFormat format) { out->append(name(format)); };
  return absl::InvalidArgumentError(absl::StrFormat("%s is written from %s, not %s", encoding.name,
                                                    absl::StrJoin(encoding.formats, " or ", names),
                                                    name(image.format)));
}

absl::Status check_display(const HdrDisplay& hdr) {
  constexpr double kMostNits = 10000;  // of PQ
  if (!(hdr.peak_nits > 0 && hdr.peak_nits <= kMostNits)) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "the display's peak is %g nit; it must be above 0 and at most %g", hdr.peak_nits, kMostNits));
  }
  for (const double nits : {hdr.max_light_nits, hdr.mean_light_nits}) {
    if (nits >= 0 && nits <= kMostNits) continue;
    return absl::InvalidArgumentError(
        absl::StrFormat("the picture's light is %g nit; it must be 0 .. %g", nits, kMostNits));
  }
  return absl::OkStatus();
}

absl::Status check_options(const OutputEncoding& encoding, const Image& image, const WriteOptions& options) {
  if (encoding.has_quality() && (options.jpeg_quality < 1 || options.jpeg_quality > 100)) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s quality %d is not within 1 .. 100", encoding.name, options.jpeg_quality));
  }
  if (!is_hdr(options.transfer) || encoding.holds_light()) return absl::OkStatus();
  if (!encoding.has_hdr()) {
    return absl::InvalidArgumentError(absl::StrFormat("%s has no word for PQ or HLG; write %s", encoding.name,
                                                      extensions_with(&OutputEncoding::has_hdr)));
  }
  if (image.format != ImageFormat::kRgba16) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "a picture in PQ or HLG has codes of 16 bits, and this one is %s", name(image.format)));
  }
  return check_display(options.hdr);
}

void note_lost_alpha(const OutputEncoding& encoding, bool had_alpha, Notes& notes) {
  if (!had_alpha || encoding.has_alpha()) return;
  notes.push_back(absl::StrFormat("alpha dropped: %s has none", encoding.extension()));
}

}  // namespace

std::span<const OutputEncoding> output_encodings() { return kEncodings; }

absl::StatusOr<const OutputEncoding*> output_encoding(const std::string& path) {
  const std::string extension = extension_of(path);
  for (const OutputEncoding& encoding : kEncodings) {
    if (std::ranges::count(encoding.extensions, extension) > 0) return &encoding;
  }
  return absl::InvalidArgumentError(
      absl::StrFormat("%s: images are not written as '%s'; use %s", path, extension, every_extension()));
}

const OutputEncoding& output_encoding(v1::Encoding by_server) {
  const bool server_encodes = by_server == v1::ENCODING_PNG || by_server == v1::ENCODING_JPEG;
  if (!server_encodes) return kEncodings[0];
  return *std::ranges::find(kEncodings, by_server, &OutputEncoding::server);
}

std::string extensions_with(bool (OutputEncoding::*member)() const) {
  std::vector<std::string> extensions;
  for (const OutputEncoding& encoding : kEncodings) {
    if (member == nullptr || (encoding.*member)()) extensions.push_back(encoding.extension());
  }
  return one_of(std::move(extensions));
}

absl::StatusOr<const OutputEncoding*> check_output_path(const std::string& path) {
  absl::StatusOr<const OutputEncoding*> encoding = output_encoding(path);
  if (!encoding.ok()) return encoding;
  if (const auto target = writable_destination(path); !target.ok()) return target.status();
  return encoding;
}

AspectRatio aspect_ratio(double pixel_aspect) {
  // Exact for ratios such as 3:2; with denominators up to 1000 others are within 0.05 %.
  for (int height = 1; height <= 1000; ++height) {
    const double width = pixel_aspect * height;
    if (width < 0.5 || width > 65535) continue;
    if (height == 1000 || std::fabs(width - std::round(width)) < 1e-5 * width) {
      return {static_cast<uint16_t>(std::round(width)), static_cast<uint16_t>(height)};
    }
  }
  return {};
}

namespace {

// Creates the file by `create`.
absl::StatusOr<Notes> write_by(const OutputEncoding& encoding, const std::string& path, const Image& image,
                               const WriteOptions& options,
                               absl::FunctionRef<absl::StatusOr<AtomicFile>()> create) {
  const auto fails = [&path](const absl::Status& status) {
    return failure_of(FailureKind::kOutput,
                      absl::Status(status.code(), absl::StrCat(path, ": ", status.message())));
  };
  absl::Status fit = check_options(encoding, image, options);
  fit.Update(check_image(encoding, image));
  if (!fit.ok()) return fails(fit);
  ASSIGN_OR_RETURN(AtomicFile file, create());
  Notes notes;
  note_lost_alpha(encoding, image.has_alpha, notes);
  const absl::Status status = encoding.write(file, image, options, notes);
  if (!status.ok() && !file.failed()) return fails(status);
  RETURN_IF_ERROR(file.commit());
  return notes;
}

}  // namespace

absl::StatusOr<Notes> write_image(const std::string& path, const Image& image, const WriteOptions& options) {
  ASSIGN_OR_RETURN(const OutputEncoding* encoding, check_output_path(path));
  return write_by(*encoding, path, image, options, [&path] { return AtomicFile::create(path); });
}

absl::StatusOr<Notes> write_image_to_stdout(const std::string& name, const Image& image,
                                            const WriteOptions& options) {
  ASSIGN_OR_RETURN(const OutputEncoding* encoding, output_encoding(name));
  return write_by(*encoding, kStdoutName, image, options, [] { return AtomicFile::for_stdout(); });
}

absl::StatusOr<Notes> write_encoded(const std::string& path, std::span<const std::byte> bytes,
                                    v1::Encoding encoding, bool has_alpha, double pixel_aspect) {
  ASSIGN_OR_RETURN(AtomicFile file, AtomicFile::create(path));
  write_with_aspect(file, bytes, pixel_aspect);
  RETURN_IF_ERROR(file.commit());
  Notes notes;
  note_lost_alpha(output_encoding(encoding), has_alpha, notes);
  return notes;
}

}  // namespace candela
