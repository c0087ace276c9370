// Numbers of Exif, and what they say of a picture. Internal to client/image.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <utility>

#include "absl/strings/string_view.h"
#include "client/image/image.h"

namespace candela {

// Numbers behind a TIFF header, which Exif and MPF begin with. Source: TIFF 6.0, section 2.
class TiffBytes {
 public:
  struct Tag {
    uint32_t type, count;
    size_t value_at;  // four bytes: the value, or where it is
  };

  explicit TiffBytes(absl::string_view bytes);
  // Bytes in a known order, without the header.
  TiffBytes(absl::string_view bytes, bool big_endian) : bytes_(bytes), big_endian_(big_endian) {}

  // Absent if the bytes end before it, or have no TIFF header.
  std::optional<uint32_t> number_16(size_t at) const { return number(at, 2); }
  std::optional<uint32_t> number_32(size_t at) const { return number(at, 4); }
  // The tag of the first directory; absent if it has none.
  std::optional<Tag> tag(uint32_t id) const { return tag_in(number_32(4).value_or(0), id); }
  // The same of the directory at this place.
  std::optional<Tag> tag_in(size_t directory, uint32_t id) const;

 private:
  std::optional<uint32_t> number(size_t at, size_t size) const;

  absl::string_view bytes_;
  bool big_endian_;
};

// Exif's orientation, 1 .. 8, of these bytes from their TIFF header on. 1, which turns nothing, if they name
// none.
int orientation_of(absl::string_view exif);

// Whether the codes are Adobe RGB's, as cameras say it: of no colour space that Exif knows, by rule R03.
bool is_adobe_rgb(absl::string_view exif);

// The fraction of this tag in the maker note of an iPhone; absent if there is none. Source: ExifTool, Apple
// tags.
std::optional<double> apple_number(absl::string_view exif, uint32_t id);

// Turns the stored pixels as Exif's orientation (1 .. 8) says. From 5 on, width and height change places.
class Turned {
 public:
  Turned(int orientation, uint32_t width, uint32_t height)
      : orientation_(orientation), width_(width), height_(height) {}

  bool is_needed() const { return orientation_ != 1; }
  bool swaps() const { return orientation_ >= 5; }
  uint32_t width() const { return swaps() ? height_ : width_; }
  uint32_t height() const { return swaps() ? width_ : height_; }
  std::array<uint32_t, 2> place(uint32_t x, uint32_t y) const {
    if (swaps()) std::swap(x, y);
    const bool from_right = orientation_ == 2 || orientation_ == 3 || orientation_ == 6 || orientation_ == 7;
    const bool from_below = orientation_ == 3 || orientation_ == 4 || orientation_ == 7 || orientation_ == 8;
    return {from_right ? width() - 1 - x : x, from_below ? height() - 1 - y : y};
  }
  // Puts the stored row `y`, of four floats a pixel, into the upright image, which is kRgba32f.
  void put_row(std::span<const float> row, uint32_t y, Image& image) const;

 private:
  int orientation_;
  uint32_t width_, height_;
};

}  // namespace candela
