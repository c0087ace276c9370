#include "client/environment/pictures.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <numbers>
#include <vector>

#include "absl/strings/str_format.h"
#include "client/environment/cube_faces.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

// Where a world's face is in the cross, and how it is turned to be seen from inside.
struct Cell {
  uint32_t face, column, row;
  bool mirrored, upside_down;
};
constexpr Cell kCross[] = {
    {1, 0, 1, true, false}, {5, 1, 1, true, false}, {0, 2, 1, true, false},
    {4, 3, 1, true, false}, {2, 1, 0, false, true}, {3, 1, 2, false, true},
};

// An opaque one of each format.
std::array<std::byte, 16> black(ImageFormat format) {
  std::array<std::byte, 16> pixel{};
  const uint16_t half_one = 0x3c00, most = 0xffff;
  const float one = 1;
  if (format == ImageFormat::kRgba8) std::memcpy(&pixel[3], &most, 1);
  if (format == ImageFormat::kRgba16) std::memcpy(&pixel[6], &most, 2);
  if (format == ImageFormat::kRgba16f) std::memcpy(&pixel[6], &half_one, 2);
  if (format == ImageFormat::kRgba32f) std::memcpy(&pixel[12], &one, 4);
  return pixel;
}

absl::StatusOr<Image> black_image(uint32_t width, uint32_t height, ImageFormat format) {
  absl::StatusOr<Image> image = make_image(width, height, format);
  if (!image.ok()) return image;
  const std::array<std::byte, 16> pixel = black(format);
  const size_t size = bytes_per_pixel(format);
  for (size_t at = 0; at < image->bytes(); at += size) std::memcpy(image->pixels.data() + at, &pixel, size);
  return image;
}

absl::Status check_has_level(const BakedEnvironment& environment, size_t level) {
  RETURN_IF_ERROR(check_environment(environment));
  if (level < environment.levels.size()) return absl::OkStatus();
  return absl::OutOfRangeError(absl::StrFormat("the environment has no level %d; it has 0 .. %d", level,
                                               environment.levels.size() - 1));
}

// The pixel at column x and row y.
std::byte* pixel_at(Image& image, uint32_t x, uint32_t y) {
  return image.pixels.data() + y * image.row_bytes() + size_t{x} * bytes_per_pixel(image.format);
}

}  // namespace

absl::StatusOr<Image> cross_picture(const BakedEnvironment& environment, size_t level) {
  RETURN_IF_ERROR(check_has_level(environment, level));
  const uint32_t size = environment.levels[level].size;
  absl::StatusOr<Image> image = black_image(4 * size, 3 * size, picture_format(environment));
  if (!image.ok()) return image;
  for (const Cell& cell : kCross) {
    for (uint32_t j = 0; j < size; ++j) {
      const uint32_t y = cell.row * size + (cell.upside_down ? size - 1 - j : j);
      copy_row_as_pixels(environment, level, {cell.face, cell.mirrored}, j,
                         pixel_at(*image, cell.column * size, y));
    }
  }
  return image;
}

absl::StatusOr<Image> equirectangular_picture(const BakedEnvironment& environment, size_t level) {
  RETURN_IF_ERROR(check_has_level(environment, level));
  const uint32_t size = environment.levels[level].size, width = 4 * size, height = 2 * size;
  absl::StatusOr<Image> image = make_image(width, height, picture_format(environment));
  if (!image.ok()) return image;
  constexpr double kPi = std::numbers::pi;
  std::vector<std::array<double, 2>> longitudes(width);  // sine and cosine
  for (uint32_t x = 0; x < width; ++x) {
    const double lon = 2 * kPi * ((x + 0.5) / width - 0.5);
    longitudes[x] = {std::sin(lon), std::cos(lon)};
  }
  const CubeLookup lookup(environment, level);
  for (uint32_t y = 0; y < height; ++y) {
    const double lat = kPi * (0.5 - (y + 0.5) / height);
    const double up = std::sin(lat), out = std::cos(lat);
    for (uint32_t x = 0; x < width; ++x) {
      const auto [sine, cosine] = longitudes[x];
      const std::array<float, 3> rgb = lookup.at(
          {static_cast<float>(sine * out), static_cast<float>(up), static_cast<float>(-cosine * out)});
      write_pixel(rgb, image->format, pixel_at(*image, x, y));
    }
  }
  return image;
}

absl::StatusOr<Image> preview_sheet(std::span<const Image> pictures, uint32_t margin) {
  if (pictures.empty()) return absl::InvalidArgumentError("a preview sheet needs a picture");
  const ImageFormat format = pictures[0].format;
  uint32_t width = margin, height = 0;
  for (const Image& picture : pictures) {
    if (picture.format != format) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "a preview sheet has pictures of one format, not %s and %s", name(format), name(picture.format)));
    }
    width += picture.width + margin;
    height = std::max(height, picture.height);
  }
  absl::StatusOr<Image> sheet = black_image(width, height + 2 * margin, format);
  if (!sheet.ok()) return sheet;
  uint32_t x = margin;
  for (const Image& picture : pictures) {
    for (uint32_t y = 0; y < picture.height; ++y) {
      std::memcpy(pixel_at(*sheet, x, margin + y), picture.pixels.data() + y * picture.row_bytes(),
                  picture.row_bytes());
    }
    x += picture.width + margin;
  }
  return sheet;
}

}  // namespace candela
