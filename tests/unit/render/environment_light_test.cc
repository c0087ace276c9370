// The float64 references of irradiance, specular levels and the BRDF table (docs/environments.md, sections 3
// to 5), against published values and mathematics.
#include <gtest/gtest.h>

#include <algorithm>

#include "tests/unit/render/environment_support.h"

namespace candela {
namespace {

using namespace reference;

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

}  // namespace
}  // namespace candela
