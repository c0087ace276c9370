// The float64 reference of a panorama's cube map (docs/environments.md, section 2).
#include <gtest/gtest.h>

#include <algorithm>

#include "tests/unit/render/environment_support.h"

namespace candela {
namespace {

using namespace reference;

TEST(CubeFace, AConstantPanoramaStaysThatConstantInEveryLevel) {
  const Rgb constant = {0.25, 3.0, 60000.0};
  for (const auto& [width, height] : kLookupSizes) {
    const Scene scene = panorama_of(width, height, [&](const Direction&) { return constant; });
    for (const CubeLevel& level : cube_chain(cube_face(scene, 16, 4, 33))) {
      for (const Rgb& c : level.texels) {
        for (size_t n = 0; n < 3; ++n) ASSERT_NEAR(c[n] / constant[n], 1.0, 1e-13);
      }
    }
  }
}

TEST(CubeFace, OneSampleIsThePanoramaAtTheTexelsCentre) {
  const Scene scene = random_panorama(9, 5, 3);
  const CubeLevel level = cube_face(scene, 16, 1, 0);
  const CubeLevel expected = cube_of(16, [&](const Direction& d) { return panorama_at(scene, d); });
  EXPECT_EQ(level.texels, expected.texels);
}

TEST(CubeFace, SamplesAreTheCentresOfEqualParts) {
  const Scene scene = random_panorama(64, 32, 3);
  const CubeLevel level = cube_face(scene, 16, 4, 0);
  const CubeLevel fine = cube_face(scene, 64, 1, 0);
  for (const auto& [face, i, j] : texels_of(16)) {
    Rgb mean{};
    for (uint32_t k = 0; k < 16; ++k) {
      const Rgb& c = fine.at(face, 4 * i + k % 4, 4 * j + k / 4);
      for (size_t n = 0; n < 3; ++n) mean[n] += c[n] / 16;
    }
    EXPECT_LT(difference(level.at(face, i, j), mean), 1e-14);
  }
}

TEST(CubeFace, ARotatedBakeIsTheBakeOfAPanoramaWithItsColumnsShifted) {
  const Scene scene = random_panorama(24, 12, 5);
  // What was ahead, at u = 0.5, is shown to the left, at u = 0.25.
  const CubeLevel expected = cube_face(shifted(scene, 6), 16, 2, 0);
  const CubeLevel level = cube_face(scene, 16, 2, 90);
  for (size_t texel = 0; texel < level.texels.size(); ++texel) {
    EXPECT_LT(difference(level.texels[texel], expected.texels[texel]), 1e-12);
  }
}

// The light of a panorama that is black beyond row y, by the midpoint rule in (u, v) over the rows around it.
double light_of_row(const Scene& scene, int y) {
  constexpr int kParts = 32;
  const int height = static_cast<int>(scene.height);
  const int width = static_cast<int>(scene.width);
  double sum = 0.0;
  for (int j = kParts * std::max(0, y - 1); j < kParts * std::min(height, y + 2); ++j) {
    const double v = (j + 0.5) / (kParts * height);
    double row = 0.0;
    for (int i = 0; i < kParts * width; ++i) row += panorama_at(scene, (i + 0.5) / (kParts * width), v)[0];
    sum += row * std::sin(kPi * v);
  }
  return sum * 2 * kPi * kPi / (kParts * width * kParts * height);
}

// A sun in a panorama of 256 x 128 texels.
struct Sun {
  const char* where;
  uint32_t x;
  uint32_t y;
  bool whole_row = false;  // the sun is round and lies on the pole
};
// The edge between -Z and +X is at x = 160, the corner above it between y = 38 and 39.
constexpr Sun kSuns[] = {{"zenith", 0, 0, true},    {"nadir", 0, 127, true},       {"seam", 0, 64},
                         {"edge", 160, 63},         {"edge, other side", 223, 63}, {"corner", 160, 38},
                         {"corner, below", 95, 39}, {"-Y's edge", 128, 96},        {"face", 128, 40}};

Scene with_sun(const Sun& sun) {
  Scene scene = panorama_of(256, 128, [](const Direction&) { return Rgb{}; });
  for (uint32_t x = 0; x < (sun.whole_row ? 256 : 1); ++x) {
    scene.texels[sun.y * 256 + (sun.x + x)] = {1000, 1000, 1000, 1};
  }
  return scene;
}

// The largest relative error of the suns' light in a level of 64 x 64 texels a face.
double worst_sun(uint32_t samples) {
  Scene all = with_sun(kSuns[0]);
  for (const Sun& sun : kSuns) {
    const Scene scene = with_sun(sun);
    for (size_t i = 0; i < all.texels.size(); ++i)
      all.texels[i][0] = std::max(all.texels[i][0], scene.texels[i][0]);
  }
  const CubeLevel level = cube_face(all, 64, samples, 0);
  double worst = 0.0;
  for (const Sun& sun : kSuns) {
    const Direction centre =
        panorama_direction((sun.x + 0.5) / 256, sun.whole_row ? sun.y / 127 : (sun.y + 0.5) / 128);
    double light = 0.0;
    for (const auto& [face, i, j] : texels_of(64)) {
      if (dot3(cube_direction(face, i, j, 64), centre) < std::cos(0.12)) continue;
      light += level.at(face, i, j)[0] * cube_solid_angle(i, j, 64);
    }
    const double error = light / light_of_row(with_sun(sun), static_cast<int>(sun.y)) - 1.0;
    ::testing::Test::RecordProperty(std::string(sun.where) + " " + std::to_string(samples),
                                    std::to_string(error));
    worst = std::max(worst, std::abs(error));
  }
  return worst;
}

TEST(CubeFace, KeepsTheLightOfASmallSun) {
  EXPECT_LT(worst_sun(4), 0.02);
  EXPECT_LT(worst_sun(16), 0.004);
}

}  // namespace
}  // namespace candela
