// The float64 reference of views (docs/environments.md, section 6): what a ray meets and what it reflects.
#include <gtest/gtest.h>

#include <algorithm>
#include <optional>

#include "tests/unit/render/view_fixture.h"

namespace candela {
namespace {

using namespace reference;

// --- reflections

// A quarter of the world is red (left), blue (right), green (behind, in a cone) and black (ahead, in a cone).
TEST(View, AChromeBallShowsLeftOnItsLeftAndBehindInItsMiddle) {
  const Scene panorama = panorama_of(64, 32, [](const Direction& d) {
    if (d[2] > 0.8) return Rgb{0, 1, 0};
    if (d[2] < -0.8) return Rgb{0, 0, 0};
    return d[0] < 0 ? Rgb{1, 0, 0} : Rgb{0, 0, 1};
  });
  Stage stage = mirror_stage({mirror({0, 0, -4}, 1)});
  stage.chain = cube_chain(cube_face(panorama, 16, 4, 0));
  Camera camera{.fov_deg = 40};
  const auto row = view_row(stage.scene(), camera, 101, 101, 1, 50);
  const auto expect = [&](size_t x, const Rgb& c) { EXPECT_LT(difference(row[x], c), 1e-9) << x; };
  // The ball reaches from x = 15 to 85. Its image is the mirror's: the world's left is on its left.
  expect(50, {0, 1, 0});
  expect(25, {1, 0, 0});
  expect(75, {0, 0, 1});
  expect(5, {0, 0, 0});  // the sky beside the ball is ahead
}

// Each pixel of the ball says, as a colour, from where it is lit. The half vector of that and of the way to
// the camera must be the normal at the place that the pixel shows.
TEST(View, ReflectionsHalveTheAngleAtTheNormalOfThePlaceThatIsSeen) {
  for (const double roughness : {0.0, 1.0}) {
    const Sphere sphere = mirror({0.4, -0.3, -3}, 0.9, roughness);
    Stage stage = mirror_stage({sphere});
    const CubeLevel directions = cube_of(64, [](const Direction& d) { return d; });
    stage.chain = cube_chain(directions);
    stage.specular = {directions, directions, directions};
    int compared = 0;
    for (uint32_t y = 0; y < 200; y += 5) {
      const auto row = view_row(stage.scene(), {}, 200, 200, 1, y);
      for (uint32_t x = 0; x < 200; x += 5) {
        const Direction d = ray(x + 0.5, y + 0.5, 200, 200, 60);
        if (!trace({}, d, sphere) || !trace({}, d, {sphere.centre, 0.85})) continue;
        const Direction n = unit({row[x][0] - d[0], row[x][1] - d[1], row[x][2] - d[2]});
        Direction place;
        for (size_t k = 0; k < 3; ++k) place[k] = sphere.centre[k] + sphere.radius * n[k];
        EXPECT_LT(difference(unit(place), d), 0.003) << x << " " << y;
        ++compared;
      }
    }
    EXPECT_GT(compared, 200);
  }
}

TEST(View, RoughnessBlendsSpecularLevels) {
  for (const double roughness : {0.0, 0.1, 0.3, 0.5, 0.9, 1.0}) {
    Stage stage = mirror_stage({mirror({0, 0, -4}, 1, roughness)});
    stage.specular.clear();
    for (const double level : {100.0, 1.0, 2.0, 3.0}) {  // the first is not read: the chain stands for it
      stage.specular.push_back(cube_of(16, [&](const Direction&) { return Rgb{level, level, level}; }));
    }
    const Rgb c = middle_of(stage);
    EXPECT_NEAR(c[0], roughness * (2 - roughness) * 3, 1e-14) << roughness;
  }
}

TEST(View, ABakeOfOneSpecularLevelReflectsLikeAMirror) {
  Stage stage = mirror_stage({mirror({0, 0, -4}, 1, 0.7)});
  stage.chain = cube_chain(cube_of(16, [](const Direction&) { return Rgb{3, 3, 3}; }));
  EXPECT_NEAR(middle_of(stage)[0], 3, 1e-14);
}

// --- materials

TEST(View, AWhiteDielectricBallInAConstantFieldIsTheField) {
  Stage stage;
  const Rgb field = {0.25, 2, 700};
  const Scene panorama = panorama_of(7, 5, [&](const Direction&) { return field; });
  stage.chain = cube_chain(cube_face(panorama, 16, 4, 0));
  stage.specular.clear();
  for (int level = 0; level < 3; ++level) stage.specular.push_back(stage.chain[0]);
  stage.irradiance = irradiance_of(panorama_sh(panorama));
  for (size_t i = 0; i < stage.brdf.size(); ++i) stage.brdf[i] = {0.9 - 4e-5 * static_cast<double>(i), 0.01};
  for (const double roughness : {0.0, 0.3, 0.77, 1.0}) {
    stage.objects = {{{0, 0, -2}, 1, {1, 1, 1}, 0, roughness, false}};
    for (const auto& row : picture_of(stage, {}, 24, 24, 4)) {
      for (const Rgb& c : row) {
        for (size_t n = 0; n < 3; ++n) ASSERT_NEAR(c[n] / field[n], 1, 1e-12) << roughness;
      }
    }
  }
}

// The table's texels hold their column's n.v and their row's roughness.
TEST(View, ReadsTheBrdfTableBilinearlyAndClampsToItsEdge) {
  Stage stage;
  stage.chain = cube_chain(cube_of(16, [](const Direction&) { return Rgb{1, 1, 1}; }));
  stage.specular = {stage.chain[0], stage.chain[0]};
  for (uint32_t i = 0; i < 128 * 128; ++i) stage.brdf[i] = {(i % 128 + 0.5) / 128, (i / 128 + 0.5) / 128};
  const auto clamped = [](double x) { return std::clamp(x, 0.5 / 128, 127.5 / 128); };
  for (const double roughness : {0.0, 0.002, 0.123, 0.777, 1.0}) {
    const Sphere sphere = {{0, 0, -2}, 1, {1, 0.25, 0}, 0.5, roughness, false};
    stage.objects = {sphere};
    stage.irradiance = {};
    const Picture picture = picture_of(stage, {}, 65, 65);
    for (uint32_t x = 0; x < 65; ++x) {
      const Direction d = ray(x + 0.5, 32.5, 65, 65, 60);
      const auto at = trace({}, d, sphere);
      if (!at) continue;
      const double nov = -dot3({*at * d[0], *at * d[1], *at * d[2] + 2}, d);
      EXPECT_NEAR(picture[32][x][0], 0.52 * clamped(nov) + clamped(roughness), 1e-12) << x;
      EXPECT_NEAR(picture[32][x][1], 0.145 * clamped(nov) + clamped(roughness), 1e-12) << x;
      EXPECT_NEAR(picture[32][x][2], 0.02 * clamped(nov) + clamped(roughness), 1e-12) << x;
    }
  }
}

TEST(View, DiffuseLightIsTheIrradianceOfTheNormalLessWhatIsReflected) {
  // Light from the right and from ahead. In the middle the normal is +Z.
  const auto light = [](const Direction& d) { return Rgb{2 + d[0], 2 - d[2], 1}; };
  Stage stage;
  stage.irradiance = irradiance_of(panorama_sh(panorama_of(256, 128, light)));
  for (BrdfSum& sum : stage.brdf) sum = {0.5, 0.1};
  stage.objects = {{{0, 0, -3}, 1, {0.5, 0.8, 1}, 0.25, 1, false}};
  const Rgb c = middle_of(stage);
  const Rgb expected_irradiance = {2 * kPi, 2 * kPi - 2 * kPi / 3, kPi};
  for (size_t n = 0; n < 3; ++n) {
    const double base = stage.objects[0].base_color[n];
    const double f = (0.04 * 0.75 + 0.25 * base) * 0.5 + 0.1;
    EXPECT_NEAR(c[n], 0.75 * base * expected_irradiance[n] / kPi * (1 - f), 1e-4) << n;
  }
}

// --- what a ray meets

TEST(View, TheNearestSphereIsSeenInAnyOrder) {
  const Sphere near = flat({0.3, 0, -3}, 0.5, kRed);
  const Sphere far = flat({-0.3, 0, -3.5}, 1, kGreen);
  const Stage stage = flat_stage({near, far});
  const Picture picture = picture_of(stage, {}, 48, 48);
  EXPECT_EQ(difference(picture, picture_of(flat_stage({far, near}), {}, 48, 48)), 0.0);
  int counts[3] = {};
  for (uint32_t y = 0; y < 48; ++y) {
    for (uint32_t x = 0; x < 48; ++x) {
      const Direction d = ray(x + 0.5, y + 0.5, 48, 48, 60);
      const double at_near = trace({}, d, near).value_or(1e9);
      const double at_far = trace({}, d, far).value_or(1e9);
      const Rgb expected = std::min(at_near, at_far) == 1e9 ? Rgb{} : at_near < at_far ? kRed : kGreen;
      EXPECT_LT(difference(picture[y][x], expected), 1e-14) << x << " " << y;
      ++counts[expected == Rgb{} ? 0 : expected == kRed ? 1 : 2];
    }
  }
  EXPECT_GT(*std::min_element(counts, counts + 3), 50);
}

TEST(View, TheFirstOfEqualSpheresIsSeen) {
  const Stage stage = flat_stage({flat({0, 0, -3}, 1, kRed), flat({0, 0, -3}, 1, kGreen)});
  EXPECT_LT(difference(middle_of(stage), kRed), 1e-14);
}

TEST(View, ASphereBehindTheCameraIsNotSeen) {
  const Stage stage = flat_stage({flat({0, 0, 3}, 1, kRed), flat({0, 0, 1.1}, 1, kRed)});
  EXPECT_EQ(difference(picture_of(stage, {}, 16, 16), picture_of(flat_stage({}), {}, 16, 16)), 0.0);
}

TEST(View, TheCamerasPositionMovesItAmongTheSpheres) {
  const Picture picture = picture_of(flat_stage({flat({0.5, 0.25, -3}, 1, kRed)}), {}, 32, 32);
  Camera camera{.position = {5, -2, 7}};
  EXPECT_EQ(difference(picture, picture_of(flat_stage({flat({5.5, -1.75, 4}, 1, kRed)}), camera, 32, 32)),
            0.0);
  // A sphere to the right stands ahead of a camera that is turned to the right.
  camera.position = {};
  camera.rotation = camera_rotation(90, 0, 0);
  const Stage turned_stage = flat_stage({flat({3, 0.25, 0.5}, 1, kRed)});
  EXPECT_LT(difference(picture, picture_of(turned_stage, camera, 32, 32)), 1e-12);
}

TEST(View, AFixedSphereStaysWhereItIsInThePicture) {
  Sphere sphere = flat({0.5, 0.25, -3}, 1, kRed);
  const Picture picture = picture_of(flat_stage({sphere}), {}, 32, 32);
  sphere.fixed_to_camera = true;
  Camera camera{.rotation = camera_rotation(33, -20, 70), .position = {5, -2, 7}};
  EXPECT_LT(difference(picture, picture_of(flat_stage({sphere}), camera, 32, 32)), 1e-12);
}

}  // namespace
}  // namespace candela
