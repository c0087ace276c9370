#include "client/image/cube_panorama.h"

#include <OpenEXR/ImfEnvmap.h>
#include <half.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <numbers>
#include <vector>

#include "absl/strings/str_format.h"

namespace candela {
namespace {

using Rgba = std::array<float, 4>;

// Reads the faces of a cube map whose components are T.
template <typename T>
class Cube {
 public:
  explicit Cube(const Image& image)
      : image_(image),
        window_(Imath::V2i(0, 0),
                Imath::V2i(static_cast<int>(image.width) - 1, static_cast<int>(image.height) - 1)) {
    for (int face = 0; face < 6; ++face) {
      const auto name = static_cast<Imf::CubeMapFace>(face);
      const auto at = [&](float x, float y) { return Imf::CubeMap::pixelPosition(name, window_, {x, y}); };
      faces_[face] = {at(0, 0), at(1, 0) - at(0, 0), at(0, 1) - at(0, 0)};
    }
  }

  // The light from a direction of any length, added to `sum`.
  void add(const Imath::V3f& direction, Rgba& sum) const {
    Imf::CubeMapFace face{};
    Imath::V2f position;
    Imf::CubeMap::faceAndPixelPosition(direction, window_, face, position);
    const int last = static_cast<int>(image_.width) - 1;
    const int x = std::clamp(static_cast<int>(position.x), 0, std::max(0, last - 1));
    const int y = std::clamp(static_cast<int>(position.y), 0, std::max(0, last - 1));
    const float right = std::clamp(position.x - static_cast<float>(x), 0.0f, 1.0f);
    const float down = std::clamp(position.y - static_cast<float>(y), 0.0f, 1.0f);
    const int x1 = std::min(x + 1, last), y1 = std::min(y + 1, last);
    add_pixel(face, x, y, (1 - right) * (1 - down), sum);
    add_pixel(face, x1, y, right * (1 - down), sum);
    add_pixel(face, x, y1, (1 - right) * down, sum);
    add_pixel(face, x1, y1, right * down, sum);
  }

 private:
  struct Face {
    Imath::V2f origin, right, down;  // where its first pixel is in the picture, and the steps along its axes
  };

  void add_pixel(int face, int x, int y, float weight, Rgba& sum) const {
    if (weight == 0) return;  // infinity times 0 is no number
    const Face& f = faces_[face];
    const Imath::V2f at = f.origin + f.right * static_cast<float>(x) + f.down * static_cast<float>(y);
    const auto column = static_cast<size_t>(std::lround(at.x)), row = static_cast<size_t>(std::lround(at.y));
    T pixel[4];
    std::memcpy(pixel, image_.pixels.data() + row * image_.row_bytes() + column * sizeof pixel, sizeof pixel);
    for (size_t c = 0; c < 4; ++c) sum[c] += weight * static_cast<float>(pixel[c]);
  }

  const Image& image_;
  const Imath::Box2i window_;
  std::array<Face, 6> faces_;
};

template <typename T>
void fill(const Image& image, Image& panorama) {
  const Cube<T> cube(image);
  const uint32_t samples = image.width >= 1024 ? 2 : 4;
  const uint32_t columns = panorama.width * samples, rows = panorama.height * samples;
  std::vector<Imath::V2f> around(columns);  // sine and cosine of each column's longitude
  for (uint32_t x = 0; x < columns; ++x) {
    const double longitude = 2 * std::numbers::pi * (0.5 - (x + 0.5) / columns);
    around[x] = Imath::V2f(static_cast<float>(std::sin(longitude)), static_cast<float>(std::cos(longitude)));
  }
  const float weight = 1.0f / static_cast<float>(samples * samples);
  std::vector<Rgba> row(panorama.width);
  for (uint32_t y = 0; y < panorama.height; ++y) {
    std::fill(row.begin(), row.end(), Rgba{});
    for (uint32_t k = 0; k < samples; ++k) {
      const double latitude = std::numbers::pi * (0.5 - (y * samples + k + 0.5) / rows);
      const auto up = static_cast<float>(std::sin(latitude)), level = static_cast<float>(std::cos(latitude));
      for (uint32_t x = 0; x < columns; ++x) {
        cube.add({around[x].x * level, up, around[x].y * level}, row[x / samples]);
      }
    }
    std::byte* out = panorama.pixels.data() + y * panorama.row_bytes();
    for (const Rgba& sum : row) {
      T pixel[4];
      for (size_t c = 0; c < 4; ++c) pixel[c] = static_cast<T>(sum[c] * weight);
      if (!image.has_alpha) pixel[3] = static_cast<T>(1.0f);  // whatever the sum was rounded to
      std::memcpy(out, pixel, sizeof pixel);
      out += sizeof pixel;
    }
  }
}

}  // namespace

absl::StatusOr<Image> panorama_of_cube(const Image& cube, uint32_t most_width, uint64_t max_bytes) {
  if (cube.height != 6 * uint64_t{cube.width}) {
    return absl::InvalidArgumentError(
        absl::StrFormat("its envmap is a cube map, but it is %dx%d; six square faces below one another are "
                        "six times as high as wide",
                        cube.width, cube.height));
  }
  uint32_t width = static_cast<uint32_t>(std::min<uint64_t>(4 * uint64_t{cube.width}, most_width));
  while (uint64_t{width} * (width / 2) * bytes_per_pixel(cube.format) > max_bytes) width /= 2;
  absl::StatusOr<Image> panorama = make_image(width, width / 2, cube.format);
  if (!panorama.ok()) return panorama;
  panorama->has_alpha = cube.has_alpha;
  panorama->frame_rate = cube.frame_rate;
  panorama->chromaticities = cube.chromaticities;
  panorama->names_primaries = cube.names_primaries;
  panorama->missing_pixels = cube.missing_pixels;
  panorama->notes = cube.notes;
  panorama->notes.push_back(
      absl::StrFormat("the cube map's faces of %dx%d were resampled to a panorama of %dx%d", cube.width,
                      cube.width, width, width / 2));
  if (cube.format == ImageFormat::kRgba16f) {
    fill<half>(cube, *panorama);
  } else {
    fill<float>(cube, *panorama);
  }
  return panorama;
}

}  // namespace candela
