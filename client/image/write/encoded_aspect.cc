// Pixel aspect in PNG and JPEG files that a server made. It knows no aspect, so it writes square pixels.
#include <zlib.h>

#include <array>
#include <cstdint>
#include <string>
#include <string_view>

#include "client/image/write/writers.h"

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

}  // namespace candela
