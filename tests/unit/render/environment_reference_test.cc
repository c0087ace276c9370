// The float64 references of a panorama's cube map and of its light (docs/environments.md).
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

// The float64 references of irradiance, specular levels and the BRDF table (docs/environments.md, sections 3
// to 5), against published values and mathematics.

constexpr uint32_t kPanoramaSizes[][2] = {{1, 1}, {2, 1}, {3, 2}, {1, 64}, {7, 5}, {32, 16}, {1024, 512}};

TEST(PanoramaSh, AConstantHasOneCoefficient) {
  for (const auto& [width, height] : kPanoramaSizes) {
    const Scene scene = panorama_of(width, height, [](const Direction&) { return Rgb{1, 2, 0.5}; });
    const Harmonics irradiance = irradiance_of(panorama_sh(scene));
    EXPECT_NEAR(irradiance[0][0], 2 * std::pow(kPi, 1.5), 1e-12) << width << "x" << height;
    EXPECT_NEAR(irradiance[0][0], 11.136656, 1e-6);
    for (size_t lm = 0; lm < 9; ++lm) {
      EXPECT_NEAR(irradiance[lm][0], lm == 0 ? irradiance[0][0] : 0.0, 1e-12)
          << width << "x" << height << " " << lm;
      EXPECT_NEAR(irradiance[lm][1], 2 * irradiance[lm][0], 1e-12);
      EXPECT_NEAR(irradiance[lm][2], irradiance[lm][0] / 2, 1e-12);
    }
    for (const Direction& n : {Direction{0, 1, 0}, Direction{0, 0, -1}, unit({1, 2, 3})}) {
      EXPECT_NEAR(irradiance_at(irradiance, n)[0], kPi, 1e-12);
    }
  }
}

// Y_lm with the six digits of Ramamoorthi and Hanrahan's paper.
std::array<double, 9> published_harmonics(const Direction& d) {
  const auto [x, y, z] = d;
  return {0.282095,
          0.488603 * y,
          0.488603 * z,
          0.488603 * x,
          1.092548 * x * y,
          1.092548 * y * z,
          0.315392 * (3 * z * z - 1),
          1.092548 * x * z,
          0.546274 * (x * x - y * y)};
}

TEST(PanoramaSh, ATexelHasTheIntegralsOfThePublishedHarmonics) {
  constexpr int kParts = 200;
  for (uint32_t texel = 0; texel < 15; ++texel) {
    Scene scene = panorama_of(5, 3, [](const Direction&) { return Rgb{}; });
    scene.texels[texel] = {1, 1, 1, 1};
    const Harmonics coefficients = panorama_sh(scene);
    std::array<double, 9> sums{};
    for (int k = 0; k < kParts * kParts; ++k) {
      const double v = (texel / 5 + (k / kParts + 0.5) / kParts) / 3;
      const auto y =
          published_harmonics(panorama_direction((texel % 5 + (k % kParts + 0.5) / kParts) / 5, v));
      const double area = 2 * kPi * kPi / 15 / (kParts * kParts) * std::sin(kPi * v);
      for (size_t lm = 0; lm < 9; ++lm) sums[lm] += area * y[lm];
    }
    for (size_t lm = 0; lm < 9; ++lm) EXPECT_NEAR(coefficients[lm][0], sums[lm], 2e-5) << texel << " " << lm;
  }
}

TEST(PanoramaSh, HalvesOfTheSphereHaveTheirKnownCoefficients) {
  // Of a hemisphere L_00 is sqrt(pi), and L_1 is sqrt(3 / (4 pi)) pi towards its middle. Band 2 is 0.
  struct Half {
    size_t axis;
    double sign;
    size_t lm;
  };
  for (const Half& half :
       {Half{0, 1, 3}, Half{0, -1, 3}, Half{1, 1, 1}, Half{1, -1, 1}, Half{2, 1, 2}, Half{2, -1, 2}}) {
    const Scene scene = panorama_of(8, 4, [&](const Direction& d) {
      const double light = half.sign * d[half.axis] > 0 ? 1 : 0;
      return Rgb{light, light, light};
    });
    const Harmonics l = panorama_sh(scene);
    for (size_t lm = 0; lm < 9; ++lm) {
      const double expected = lm == 0         ? std::sqrt(kPi)
                              : lm == half.lm ? half.sign * std::sqrt(3 * kPi / 4)
                                              : 0.0;
      EXPECT_NEAR(l[lm][0], expected, 1e-14) << half.axis << " " << half.sign << " " << lm;
    }
    Direction n{};
    n[half.axis] = half.sign;
    EXPECT_NEAR(irradiance_at(irradiance_of(l), n)[0], kPi, 1e-14);
    n[half.axis] = -half.sign;
    EXPECT_NEAR(irradiance_at(irradiance_of(l), n)[0], 0.0, 1e-14);
  }
}

TEST(PanoramaSh, ALinearPanoramaHasItsAnalyticCoefficients) {
  const Direction w = unit({1, -2, 3});
  const Scene scene = panorama_of(1024, 512, [&](const Direction& d) {
    return Rgb{2 + dot3(d, w), 2 - dot3(d, w), dot3(d, w)};
  });
  const Harmonics l = panorama_sh(scene);
  // Texels are flat: the error is a texel's angle squared over 24 of the linear part.
  EXPECT_NEAR(l[0][0], 2 * std::sqrt(4 * kPi), 1e-5);
  const Direction band = {l[3][0], l[1][0], l[2][0]};
  for (size_t axis = 0; axis < 3; ++axis) EXPECT_NEAR(band[axis], w[axis] * std::sqrt(4 * kPi / 3), 1e-5);
  for (size_t lm = 4; lm < 9; ++lm) EXPECT_NEAR(l[lm][0], 0.0, 1e-5);
  const Direction n = unit({2, 1, 0.5});
  const Rgb irradiance = irradiance_at(irradiance_of(l), n);
  EXPECT_NEAR(irradiance[0], 2 * kPi + 2 * kPi / 3 * dot3(n, w), 1e-4);
  EXPECT_NEAR(irradiance[1], 2 * kPi - 2 * kPi / 3 * dot3(n, w), 1e-4);
  // Irradiance is never negative.
  EXPECT_NEAR(irradiance_at(irradiance_of(l), w)[2], 2 * kPi / 3, 1e-4);
  EXPECT_EQ(irradiance_at(irradiance_of(l), {-w[0], -w[1], -w[2]})[2], 0.0);
}

TEST(PanoramaSh, TurnedIsTheShOfThePanoramaWithItsColumnsShifted) {
  const Scene scene = random_panorama(16, 7, 2);
  const Harmonics l = panorama_sh(scene);
  // +90 degrees move what was ahead to the left, a quarter of the width away.
  for (const auto& [columns, deg] :
       {std::pair{4u, 90.0}, {8u, 180.0}, {12u, -90.0}, {1u, 22.5}, {15u, 337.5}}) {
    const Harmonics expected = panorama_sh(shifted(scene, columns));
    const Harmonics got = turned(l, deg);
    for (size_t lm = 0; lm < 9; ++lm) EXPECT_LT(difference(got[lm], expected[lm]), 1e-13) << deg << " " << lm;
  }
}

TEST(PanoramaSh, TurnedIsLookedUpWithDirectionsThatAreTurnedBack) {
  const Harmonics l = irradiance_of(panorama_sh(random_panorama(9, 5, 4)));
  Random random(1);
  for (int i = 0; i < 50; ++i) {
    const Direction n = random.direction();
    EXPECT_LT(difference(irradiance_at(turned(l, 77), n), irradiance_at(l, turned_back(n, 77))), 1e-13);
  }
}

TEST(CubeSpecular, LevelsEndAtSixteen) {
  EXPECT_EQ(specular_levels(16), 1u);
  EXPECT_EQ(specular_levels(32), 2u);
  EXPECT_EQ(specular_levels(256), 5u);
  EXPECT_EQ(specular_levels(4096), 9u);
}

TEST(CubeSpecular, RoughnessRunsFromZeroToOne) {
  for (const auto mapping : {RoughnessMapping::kLinear, RoughnessMapping::kPerceptual}) {
    EXPECT_EQ(specular_roughness(0, 1, mapping), 0.0);
    EXPECT_EQ(specular_roughness(0, 6, mapping), 0.0);
    EXPECT_EQ(specular_roughness(5, 6, mapping), 1.0);
  }
  EXPECT_DOUBLE_EQ(specular_roughness(2, 5, RoughnessMapping::kLinear), 0.5);
  EXPECT_DOUBLE_EQ(specular_roughness(3, 5, RoughnessMapping::kPerceptual), 0.5);
  for (uint32_t level = 0; level < 7; ++level) {
    const double r = specular_roughness(level, 7, RoughnessMapping::kPerceptual);
    EXPECT_NEAR(r * (2 - r) * 6, level, 1e-14);
  }
}

TEST(CubeSpecular, AConstantStaysThatConstant) {
  for (const auto& [width, height] : kPanoramaSizes) {
    if (width == 1024) continue;
    const Scene scene = panorama_of(width, height, [](const Direction&) { return Rgb{0.25, 3, 60000}; });
    for (const double roughness : {0.15, 0.5, 1.0}) {
      const Rgb e = specular_at(scene, {0.1, -0.9, 0.3}, roughness);
      EXPECT_NEAR(e[0] / 0.25, 1.0, 1e-12) << width << "x" << height << " " << roughness;
      EXPECT_NEAR(e[1] / 3, 1.0, 1e-12);
      EXPECT_NEAR(e[2] / 60000, 1.0, 1e-12);
    }
  }
}

TEST(CubeSpecular, ALobeSeesARowThatIsAsHighAsTheSphere) {
  // Straight up there is no texel's centre in the lobe.
  const Scene scene = panorama_of(1024, 1, [](const Direction&) { return Rgb{1, 2, 3}; });
  EXPECT_LT(difference(specular_at(scene, {0, 1, 0}, 0.9), {1, 2, 3}), 1e-12);
}

TEST(CubeSpecular, ALinearPanoramaKeepsTheAnalyticPartOfItsSlope) {
  constexpr double kFactors[][2] = {{0.1, 0.95435439}, {0.4, 0.79876793}, {0.7, 0.71239122}, {1, 2.0 / 3}};
  const Direction w = unit({1, -2, 3});
  const Scene scene = panorama_of(1024, 512, [&](const Direction& d) { return Rgb{2 + dot3(d, w), 1, 0}; });
  double worst = 0.0;
  for (const auto& [alpha, factor] : kFactors) {
    for (const Direction& n : {w, Direction{0, 1, 0}, unit({0, -0.2, 1})}) {
      const Rgb e = specular_at(scene, {5 * n[0], 5 * n[1], 5 * n[2]}, std::sqrt(alpha));  // any length
      worst = std::max(worst, std::abs((e[0] - 2) / dot3(n, w) - factor));
      EXPECT_NEAR((e[0] - 2) / dot3(n, w), factor, 5e-6) << alpha;
      EXPECT_NEAR(e[1], 1.0, 1e-12);
    }
  }
  RecordProperty("worst", std::to_string(worst * 1e6) + "e-6");
}

TEST(CubeSpecular, ANarrowLobeReadsBetweenTexels) {
  const Scene scene = random_panorama(32, 16, 6);
  // A quarter of a texel off the centre of texel (9, 6), right and down. Each texel has weights of 9, 3, 3
  // and 1.
  const Direction n = panorama_direction((9 + 0.75) / 32, (6 + 0.75) / 16);
  const Rgb expected = panorama_at(scene, n);
  const Rgb e = specular_at(scene, n, 0.1);
  EXPECT_LT(difference(e, expected), 0.02);
  // The texel alone would be far off.
  const auto& texel = scene.at(9, 6);
  EXPECT_GT(difference({texel[0], texel[1], texel[2]}, expected), 0.1);
}

TEST(CubeSpecular, IsTheIntegralOverTheLobe) {
  const auto light = [](double y) { return Rgb{std::exp(4 * y - 4), std::max(0.0, y * y * y), 1 - y}; };
  const Scene scene = panorama_of(512, 256, [&](const Direction& d) { return light(d[1]); });
  for (const double roughness : {0.3, 0.6, 0.9}) {
    // Around the straight upward direction the integral has only the angle from it.
    const double alpha2 = std::pow(roughness, 4);
    Rgb sum{};
    double weights = 0.0;
    for (int i = 0; i < 20000; ++i) {
      const double angle = (i + 0.5) / 20000 * kPi / 2;
      const double h2 = std::pow(std::cos(angle / 2), 2);
      const double weight = std::cos(angle) * std::sin(angle) / std::pow(h2 * (alpha2 - 1) + 1, 2);
      for (size_t n = 0; n < 3; ++n) sum[n] += weight * light(std::cos(angle))[n];
      weights += weight;
    }
    const Rgb e = specular_at(scene, {0, 1, 0}, roughness);
    for (size_t n = 0; n < 3; ++n) EXPECT_NEAR(e[n], sum[n] / weights, 1e-4) << roughness << " " << n;
  }
}

TEST(BrdfTable, HasThePublishedValues) {
  struct Row {
    double nov, roughness, scale, bias;
  };
  for (const Row& row : {Row{0.5, 0.5, 0.8349162, 0.0223473}, Row{0.1, 0.1, 0.4157697, 0.5783542},
                         Row{0.1, 1, 0.7363436, 0.0238669}, Row{1, 0.5, 0.9157850, 0.0000274},
                         Row{0.5, 1, 0.4477051, 0.0029887}, Row{0.25, 0.75, 0.7165080, 0.0279483},
                         Row{0.75, 0.25, 0.9923089, 0.0015022}}) {
    const BrdfSum sum = brdf_sum(row.nov, row.roughness);
    EXPECT_NEAR(sum.scale, row.scale, 1e-7) << row.nov << " " << row.roughness;
    EXPECT_NEAR(sum.bias, row.bias, 1e-7) << row.nov << " " << row.roughness;
  }
}

TEST(BrdfTable, ReflectsOneLessLogTwoOfNormalLightAtFullRoughness) {
  const BrdfSum sum = brdf_sum(1, 1);
  EXPECT_NEAR(sum.scale + sum.bias, 1 - std::log(2.0), 1e-12);
}

TEST(BrdfTable, ASmoothSurfaceIsSchlicksMirror) {
  for (const double nov : {0.5 / 128, 0.3, 0.6, 1.0}) {
    const BrdfSum sum = brdf_sum(nov, 0);
    EXPECT_NEAR(sum.bias, std::pow(1 - nov, 5), 1e-9) << nov;
    EXPECT_NEAR(sum.scale, 1 - std::pow(1 - nov, 5), 1e-9) << nov;
  }
}

TEST(BrdfTable, ReflectsNoMoreThanAllLight) {
  for (double nov = 0.5 / 128; nov < 1; nov += 7.0 / 128) {
    for (double roughness = 0.5 / 128; roughness < 1; roughness += 7.0 / 128) {
      const BrdfSum sum = brdf_sum(nov, roughness);
      EXPECT_GT(sum.scale, 0.0);
      EXPECT_GE(sum.bias, 0.0);
      EXPECT_LE(sum.scale + sum.bias, 1.0 + 1e-7) << nov << " " << roughness;
    }
  }
}

// The float64 references of panoramas and cube maps (docs/environments.md, sections 1 and 2), against
// mathematics and Vulkan's rules.

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
