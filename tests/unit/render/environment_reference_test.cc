// The float64 references of panoramas and cube maps (docs/environments.md, sections 1 and 2), against
// mathematics and Vulkan's rules.
#include <gtest/gtest.h>

#include <algorithm>

#include "tests/unit/render/environment_support.h"

namespace candela {
namespace {

using namespace reference;

TEST(Panorama, ShowsAheadInTheMiddleAndTheRightToTheRight) {
  const auto expect = [](double u, double v, const Direction& d) {
    EXPECT_LT(difference(panorama_direction(u, v), d), 1e-15) << u << " " << v;
  };
  expect(0.5, 0.5, {0, 0, -1});
  expect(0.75, 0.5, {1, 0, 0});
  expect(0.25, 0.5, {-1, 0, 0});
  expect(0.0, 0.5, {0, 0, 1});
  expect(1.0, 0.5, {0, 0, 1});
  expect(0.3, 0.0, {0, 1, 0});
  expect(0.3, 1.0, {0, -1, 0});
  expect(0.625, 0.25, {0.5, std::sqrt(0.5), -0.5});
}

TEST(Panorama, DirectionsAndPlacesAreInverses) {
  for (int y = 1; y < 64; ++y) {
    for (int x = 0; x < 64; ++x) {
      const double u = (x + 0.5) / 64;
      const double v = y / 64.0;
      Direction d = panorama_direction(u, v);
      EXPECT_NEAR(dot3(d, d), 1.0, 1e-15);
      for (double& c : d) c *= 1000.0;  // any length
      const auto [u2, v2] = panorama_uv(d);
      EXPECT_NEAR(u2, u, 1e-15);
      EXPECT_NEAR(v2, v, 1e-15);
    }
  }
  for (const double length : {1e-8, 1.0, 1e8}) {
    EXPECT_EQ(panorama_uv({1e-300, 0, length})[0], 1.0);
    EXPECT_EQ(panorama_uv({-1e-300, 0, length})[0], 0.0);
  }
}

TEST(Panorama, TheLongitudeOfAPoleIsZero) {
  for (const double x : {0.0, -0.0}) {
    for (const double z : {0.0, -0.0}) {
      EXPECT_EQ(panorama_uv({x, 1, z}), (std::array{0.5, 0.0}));
      EXPECT_EQ(panorama_uv({x, -3, z}), (std::array{0.5, 1.0}));
    }
  }
}

TEST(Panorama, TexelsOfEverySizeCoverTheSphere) {
  constexpr uint32_t kSizes[][2] = {{1, 1}, {2, 1}, {3, 2}, {1, 64}, {7, 5}, {1024, 512}};
  for (const auto& [width, height] : kSizes) {
    const Scene scene{width, height, {}, {}};
    double sum = 0.0;
    for (uint32_t y = 0; y < height; ++y) sum += width * panorama_solid_angle(scene, y);
    EXPECT_NEAR(sum / (4 * kPi), 1.0, 1e-12) << width << "x" << height;
  }
  // Between the latitudes of +-30 degrees lies one half of the sphere (Archimedes).
  const Scene thirds{4, 3, {}, {}};
  EXPECT_NEAR(panorama_solid_angle(thirds, 0), kPi / 4, 1e-15);
  EXPECT_NEAR(panorama_solid_angle(thirds, 1), kPi / 2, 1e-15);
}

TEST(Panorama, ALookupAtATexelsCentreIsThatTexel) {
  for (const auto& [width, height] : kLookupSizes) {
    const Scene scene = random_panorama(width, height, width);
    for (uint32_t y = 0; y < height; ++y) {
      for (uint32_t x = 0; x < width; ++x) {
        const auto& c = scene.at(x, y);
        const Direction d = panorama_direction((x + 0.5) / width, (y + 0.5) / height);
        EXPECT_LT(difference(panorama_at(scene, d), {c[0], c[1], c[2]}), 1e-13);
      }
    }
  }
}

// Light changes by less than 2 (width + height) over an angle of 1.
TEST(Panorama, HasNoSeam) {
  constexpr double kStep = 1e-9;
  for (const auto& [width, height] : kLookupSizes) {
    const Scene scene = random_panorama(width, height, width);
    for (double lat = -1.5; lat < 1.5; lat += 0.01) {
      const auto at = [&](double lon) {
        return panorama_at(scene,
                           {std::sin(lon) * std::cos(lat), std::sin(lat), -std::cos(lon) * std::cos(lat)});
      };
      EXPECT_LT(difference(at(kPi - kStep), at(kPi + kStep)), 1e-7) << width << "x" << height << " " << lat;
    }
  }
}

TEST(Panorama, IsContinuousAlongEveryMeridianOverThePoles) {
  constexpr double kStep = 1e-9;
  for (const auto& [width, height] : kLookupSizes) {
    const Scene scene = random_panorama(width, height, width);
    for (double lon = -3.1; lon < 3.1; lon += 0.01) {
      for (const double pole : {1.0, -1.0}) {
        const Rgb here = panorama_at(scene, {kStep * std::sin(lon), pole, -kStep * std::cos(lon)});
        const Rgb there = panorama_at(scene, {-kStep * std::sin(lon), pole, kStep * std::cos(lon)});
        EXPECT_LT(difference(here, there), 1e-7) << width << "x" << height << " " << lon;
      }
    }
  }
}

TEST(Panorama, APoleIsTheMeanOfBothSidesEvenIfTheWidthIsOdd) {
  const Scene scene = random_panorama(3, 2, 1);
  const Rgb pole = panorama_at(scene, {0, 1, 0});
  for (size_t n = 0; n < 3; ++n) {
    // u = 0.5 is the middle of texel 1, u = 1 lies between the texels 2 and 0.
    const double behind = 0.5 * scene.at(2, 0)[n] + 0.5 * scene.at(0, 0)[n];
    EXPECT_NEAR(pole[n], 0.5 * scene.at(1, 0)[n] + 0.5 * behind, 1e-15);
  }
  // A quarter of a texel's height above the first row's centre and a quarter of its width beside it.
  const Rgb beside = panorama_at(scene, 0.5 + 0.25 / 3, 0.25 / 2);
  for (size_t n = 0; n < 3; ++n) {
    const double here = 0.75 * scene.at(1, 0)[n] + 0.25 * scene.at(2, 0)[n];
    const double behind = 0.25 * scene.at(2, 0)[n] + 0.75 * scene.at(0, 0)[n];
    EXPECT_NEAR(beside[n], 0.75 * here + 0.25 * behind, 1e-15);
  }
}

TEST(Panorama, ARotationMovesWhatWasAheadToTheLeft) {
  // Whoever looks to the left in the turned environment finds what was ahead.
  EXPECT_LT(difference(turned_back({-1, 0, 0}, 90), {0, 0, -1}), 1e-15);
  EXPECT_LT(difference(turned_back({0, 0, 1}, 180), {0, 0, -1}), 1e-15);
  EXPECT_LT(difference(turned_back({1, 0, 0}, 270), {0, 0, -1}), 1e-15);
  EXPECT_LT(difference(turned_back({-std::sqrt(0.5), 2, -std::sqrt(0.5)}, 45), {0, 2, -1}), 1e-15);
}

// The table "Cube map face and coordinate selection" of the Vulkan specification. Axes are 0 .. 2 for rx, ry
// and rz.
struct FaceRule {
  size_t major;
  double sign;
  size_t sc;
  double sc_sign;
  size_t tc;
  double tc_sign;
};
constexpr FaceRule kVulkanFaces[6] = {{0, 1, 2, -1, 1, -1}, {0, -1, 2, 1, 1, -1}, {1, 1, 0, 1, 2, 1},
                                      {1, -1, 0, 1, 2, -1}, {2, 1, 0, 1, 1, -1},  {2, -1, 0, -1, 1, -1}};

struct Place {
  uint32_t face;
  double s;  // 0 .. 1
  double t;
};

Place vulkan_place(const Direction& r) {
  uint32_t face = 0;
  double major = 0.0;
  for (uint32_t f = 0; f < 6; ++f) {
    const double along = kVulkanFaces[f].sign * r[kVulkanFaces[f].major];
    if (along > major) {
      face = f;
      major = along;
    }
  }
  const FaceRule& rule = kVulkanFaces[face];
  return {face, (rule.sc_sign * r[rule.sc] / major + 1.0) / 2.0,
          (rule.tc_sign * r[rule.tc] / major + 1.0) / 2.0};
}

TEST(Cube, TexelsLieWhereVulkanFindsTheirDirections) {
  for (const uint32_t size : {1u, 2u, 16u, 64u}) {
    for (const auto& [face, i, j] : texels_of(size)) {
      const Direction d = cube_direction(face, i, j, size);
      EXPECT_NEAR(dot3(d, d), 1.0, 1e-15);
      const Place place = vulkan_place(d);
      ASSERT_EQ(place.face, face);
      EXPECT_NEAR(place.s * size, i + 0.5, 1e-12);
      EXPECT_NEAR(place.t * size, j + 0.5, 1e-12);
      const CubeSpot spot = cube_spot(d);
      ASSERT_EQ(spot.face, face);
      EXPECT_NEAR((spot.s + 1) / 2 * size, i + 0.5, 1e-12);
      EXPECT_NEAR((spot.t + 1) / 2 * size, j + 0.5, 1e-12);
    }
  }
}

TEST(Cube, TexelsOfEveryLevelCoverTheSphere) {
  for (const uint32_t size : {1u, 2u, 4u, 16u, 64u, 512u}) {
    double sum = 0.0;
    for (uint32_t j = 0; j < size; ++j) {
      for (uint32_t i = 0; i < size; ++i) sum += 6.0 * cube_solid_angle(i, j, size);
    }
    EXPECT_NEAR(sum / (4 * kPi), 1.0, 1e-12) << size;
  }
}

TEST(Cube, ATexelCoversTheSolidAngleThatItShows) {
  for (uint32_t texel = 0; texel < 16; ++texel) {
    // The midpoint rule over the texel. A part of the face of area dA has dA / (s^2 + t^2 + 1)^1.5.
    double sum = 0.0;
    for (uint32_t k = 0; k < 10000; ++k) {
      const double s = 2.0 * (texel % 4 + (k % 100 + 0.5) / 100) / 4 - 1;
      const double t = 2.0 * (texel / 4 + (k / 100 + 0.5) / 100) / 4 - 1;
      sum += 0.25 / 10000 * std::pow(s * s + t * t + 1, -1.5);
    }
    EXPECT_NEAR(cube_solid_angle(texel % 4, texel / 4, 4), sum, 1e-6);
  }
}

TEST(Cube, DefaultSizeIsAQuarterOfTheWidthOrMore) {
  constexpr uint32_t kWidths[][2] = {{1, 16},      {64, 16},     {65, 32},      {1000, 256},  {4096, 1024},
                                     {4097, 2048}, {8192, 2048}, {16384, 2048}, {32768, 2048}};
  for (const auto& [width, size] : kWidths) EXPECT_EQ(cube_default_size(width), size) << width;
}

CubeLevel random_cube(uint32_t size) {
  Random random(size);
  return cube_of(size, [&](const Direction&) { return random.color(); });
}

TEST(Cube, ALookupAtATexelsCentreIsThatTexel) {
  for (const uint32_t size : {1u, 2u, 8u}) {
    const CubeLevel level = random_cube(size);
    for (const auto& [face, i, j] : texels_of(size))
      EXPECT_LT(difference(cube_at(level, cube_direction(face, i, j, size)), level.at(face, i, j)), 1e-13);
  }
}

TEST(Cube, LookupsAreContinuousAcrossAllEdges) {
  constexpr double kStep = 1e-9;
  for (const uint32_t size : {1u, 2u, 4u, 16u}) {
    const CubeLevel level = random_cube(size);
    for (uint32_t edge = 0; edge < 12; ++edge) {
      const size_t along = edge % 3;
      const size_t a = (along + 1) % 3;
      const size_t b = (along + 2) % 3;
      for (double t = -1.0; t <= 1.0; t += 1.0 / 64) {
        Direction d{};
        d[along] = t * (1 - 2 * kStep);
        d[a] = edge / 3 % 2 == 0 ? 1 : -1;
        d[b] = edge / 6 == 0 ? 1 : -1;
        Direction on_a = d;
        Direction on_b = d;
        on_a[b] *= 1 - kStep;
        on_b[a] *= 1 - kStep;
        ASSERT_NE(cube_spot(on_a).face, cube_spot(on_b).face);
        EXPECT_LT(difference(cube_at(level, on_a), cube_at(level, on_b)), 1e-7)
            << size << " " << edge << " " << t;
      }
    }
  }
}

TEST(Cube, ACornerIsTheMeanOfItsThreeTexels) {
  for (const uint32_t size : {1u, 2u, 4u, 16u}) {
    const CubeLevel level = random_cube(size);
    for (uint32_t corner = 0; corner < 8; ++corner) {
      const Direction d = {corner & 1 ? 1.0 : -1.0, corner & 2 ? 1.0 : -1.0, corner & 4 ? 1.0 : -1.0};
      // Beside the corner, on the face of this axis.
      const auto inside = [&](size_t axis) {
        Direction beside = d;
        for (size_t other = 0; other < 3; ++other) beside[other] *= other == axis ? 1.0 : 1.0 - 1e-9;
        return beside;
      };
      Rgb mean{};
      for (size_t axis = 0; axis < 3; ++axis) {
        const Place place = vulkan_place(inside(axis));
        const auto i = static_cast<uint32_t>(place.s * size);
        const auto j = static_cast<uint32_t>(place.t * size);
        for (size_t n = 0; n < 3; ++n) mean[n] += level.at(place.face, i, j)[n] / 3.0;
      }
      for (size_t axis = 0; axis < 3; ++axis)
        EXPECT_LT(difference(cube_at(level, inside(axis)), mean), 1e-7) << size << " " << corner;
    }
  }
}

TEST(Cube, LookupsOfASmoothCubeAreItsLight) {
  // Texels are up to 0.06 apart. The mean in the corners is the least smooth place.
  const CubeLevel level = cube_of(32, [](const Direction& d) { return d; });
  Random random(1);
  double worst = 0.0;
  for (int i = 0; i < 20000; ++i) {
    const Direction d = random.direction();
    worst = std::max(worst, difference(cube_at(level, d), d));
  }
  RecordProperty("worst", std::to_string(worst));
  EXPECT_LT(worst, 0.008);
}

TEST(Cube, LookupsBlendLevelsByLod) {
  std::vector<CubeLevel> chain;
  for (const uint32_t size : {4u, 2u, 1u}) {
    chain.push_back(cube_of(size, [&](const Direction&) { return Rgb{std::log2(size), 0, 1}; }));
  }
  const Direction d = unit({0.3, 0.8, -0.2});
  for (const double lod : {-5.0, 0.0, 0.25, 1.0, 1.9, 2.0, 7.0}) {
    const Rgb c = cube_at(chain, d, lod);
    EXPECT_NEAR(c[0], 2 - std::clamp(lod, 0.0, 2.0), 1e-15) << lod;
    EXPECT_NEAR(c[2], 1.0, 1e-15);
  }
}

TEST(Cube, EachLevelHasTheLightOfTheOneBefore) {
  const std::vector<CubeLevel> chain = cube_chain(random_cube(64));
  ASSERT_EQ(chain.size(), 7u);
  EXPECT_EQ(chain.back().size, 1u);
  const Rgb light = integral_of(chain[0]);
  for (const CubeLevel& level : chain) {
    const Rgb same = integral_of(level);
    for (size_t n = 0; n < 3; ++n) EXPECT_NEAR(same[n] / light[n], 1.0, 1e-12) << level.size;
  }
}

TEST(Cube, ATexelHasItsOwnFourTexelsLight) {
  const CubeLevel fine = random_cube(4);
  const CubeLevel coarse = cube_down(fine);
  // At the middle of a face's edge all four weights are known: two texels touch the middle line.
  const double inner = cube_solid_angle(1, 0, 4);
  const double outer = cube_solid_angle(0, 0, 4);
  const double middle = cube_solid_angle(1, 1, 4);
  EXPECT_GT(middle, inner);
  EXPECT_GT(inner, outer);
  for (uint32_t face = 0; face < 6; ++face) {
    const Rgb& c = coarse.at(face, 1, 0);
    for (size_t n = 0; n < 3; ++n) {
      const double sum = inner * fine.at(face, 2, 0)[n] + outer * fine.at(face, 3, 0)[n] +
                         middle * fine.at(face, 2, 1)[n] + inner * fine.at(face, 3, 1)[n];
      EXPECT_NEAR(c[n], sum / (2 * inner + outer + middle), 1e-14);
    }
  }
}

}  // namespace
}  // namespace candela
