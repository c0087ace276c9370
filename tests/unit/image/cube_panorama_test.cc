// OpenEXR's cube maps as panoramas.
#include "client/image/cube_panorama.h"

#include <OpenEXR/ImfEnvmap.h>
#include <OpenEXR/ImfStandardAttributes.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <numbers>
#include <utility>
#include <vector>

#include "tests/support/status.h"
#include "tests/unit/image/exr_reader_fixture.h"

namespace candela {
namespace {

using Imath::V3f;
constexpr double kPi = std::numbers::pi;

class CubePanorama : public ExrReader {
 protected:
  // Writes a cube map with faces of n x n, whose pixel shows light(direction).
  template <typename Light>
  Image cube(int n, Imf::PixelType type, Light light) {
    Imf::Header header(n, 6 * n);
    Imf::addEnvmap(header, Imf::ENVMAP_CUBE);
    // OpenEXR's own table of the faces.
    const Imath::Box2i window({0, 0}, {n - 1, 6 * n - 1});
    std::vector<V3f> values(static_cast<size_t>(6 * n * n));
    for (int i = 0; i < 6 * n * n; ++i) {
      const auto face = static_cast<Imf::CubeMapFace>(i / (n * n));
      const Imath::V2f position(static_cast<float>(i % n), static_cast<float>(i / n % n));
      const Imath::V2f at = Imf::CubeMap::pixelPosition(face, window, position);
      values[static_cast<size_t>(std::lround(at.y) * n + std::lround(at.x))] =
          light(Imf::CubeMap::direction(face, window, position).normalized());
    }
    const auto channel = [&](const char* name, int c) {
      return ExrChannel{name, type, [&values, n, c](int x, int y) {
                          return static_cast<double>(values[static_cast<size_t>(y * n + x)][c]);
                        }};
    };
    write_scan_lines(path_, header, {channel("R", 0), channel("G", 1), channel("B", 2)});
    Image image = read();
    EXPECT_TRUE(image.is_cube_map);
    return image;
  }

  static Image panorama(const Image& cube, uint32_t most_width = 8192, uint64_t max_bytes = 1u << 29) {
    absl::StatusOr<Image> made = panorama_of_cube(cube, most_width, max_bytes);
    EXPECT_OK(made);
    return made.ok() ? *std::move(made) : Image{};
  }

  // The direction of a panorama's pixel in OpenEXR's axes, from its own projection's definition.
  static V3f direction(const Image& image, uint32_t x, uint32_t y) {
    const double longitude = kPi - 2 * kPi * (x + 0.5) / image.width;
    const double latitude = kPi / 2 - kPi * (y + 0.5) / image.height;
    return {static_cast<float>(std::sin(longitude) * std::cos(latitude)),
            static_cast<float>(std::sin(latitude)),
            static_cast<float>(std::cos(longitude) * std::cos(latitude))};
  }
};

TEST_F(CubePanorama, ShowsEachDirectionWhereOpenExrsProjectionHasIt) {
  for (const auto type : {Imf::HALF, Imf::FLOAT}) {
    const auto light = [](const V3f& d) { return V3f(2 + d.x, 2 + d.y, 2 + d.z); };
    const Image image = panorama(cube(64, type, light));
    EXPECT_EQ(image.width, 256u);
    EXPECT_EQ(image.height, 128u);
    EXPECT_EQ(image.format, type == Imf::HALF ? ImageFormat::kRgba16f : ImageFormat::kRgba32f);
    for (uint32_t y = 0; y < image.height; ++y) {
      for (uint32_t x = 0; x < image.width; ++x) {
        const V3f expected = light(direction(image, x, y));
        for (int c = 0; c < 3; ++c)
          ASSERT_NEAR(component(image, x, y, c), expected[c], 3e-3) << x << "," << y;
        ASSERT_EQ(component(image, x, y, 3), 1);
      }
    }
  }
}

TEST_F(CubePanorama, KeepsConstantLightAndTheEnergyOfASun) {
  const Image flat = panorama(cube(16, Imf::FLOAT, [](const V3f&) { return V3f(3, 5, 7); }));
  for (uint32_t y = 0; y < flat.height; ++y) {
    for (uint32_t x = 0; x < flat.width; ++x) ASSERT_NEAR(component(flat, x, y, 1), 5, 1e-5);
  }
  // One pixel inside a face. Its bilinear hat covers four pixels' areas of weight 1/4 each.
  const int n = 33;
  Image sun = cube(n, Imf::FLOAT, [](const V3f&) { return V3f(0, 0, 0); });
  for (const auto& [row, column] : {std::pair(n / 2, n / 2), std::pair(5, 27)}) {
    std::memset(sun.pixels.data(), 0, sun.bytes());
    const float bright = 1000;
    std::memcpy(sun.pixels.data() + row * sun.row_bytes() + static_cast<size_t>(column) * 16, &bright, 4);
    const Image image = panorama(sun);
    double energy = 0;
    for (uint32_t y = 0; y < image.height; ++y) {
      const double area =
          2 * kPi / image.width *
          (std::sin(kPi / 2 - kPi * y / image.height) - std::sin(kPi / 2 - kPi * (y + 1) / image.height));
      for (uint32_t x = 0; x < image.width; ++x) energy += area * component(image, x, y, 0);
    }
    // The hat's integral over the sphere, in small steps on the face.
    double expected = 0;
    const double step = 2.0 / (n - 1);
    constexpr int kSteps = 200;
    for (int j = -kSteps; j < kSteps; ++j) {
      for (int i = -kSteps; i < kSteps; ++i) {
        const double a = (i + 0.5) / kSteps, b = (j + 0.5) / kSteps;
        const double s = (column + a) * step - 1, t = (row + b) * step - 1;
        expected += 1000 * (1 - std::fabs(a)) * (1 - std::fabs(b)) * step * step / (kSteps * kSteps) /
                    std::pow(1 + s * s + t * t, 1.5);
      }
    }
    EXPECT_NEAR(energy / expected, 1, 0.02);
  }
}

TEST_F(CubePanorama, StaysWithinTheLimits) {
  const Image small = cube(8, Imf::HALF, [](const V3f&) { return V3f(1, 1, 1); });
  EXPECT_EQ(panorama(small, 20).width, 20u);
  EXPECT_EQ(panorama(small, 8192, 16 * 8 * 8).width, 16u);
  Image wrong = panorama(small);
  EXPECT_REFUSED(kInvalidArgument, "it is 32x16", panorama_of_cube(wrong, 8192, 1 << 20));
}

}  // namespace
}  // namespace candela
