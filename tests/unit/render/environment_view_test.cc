// The float64 reference of views (docs/environments.md, section 6), against geometry that is computed here in
// another way: the camera, the sky and the rays of a pixel.
#include <gtest/gtest.h>

#include <algorithm>
#include <optional>

#include "tests/unit/render/view_fixture.h"

namespace candela {
namespace {

using namespace reference;

Direction seen(const Rotation& m, const Direction& d) {
  return {m[0] * d[0] + m[1] * d[1] + m[2] * d[2], m[3] * d[0] + m[4] * d[1] + m[5] * d[2],
          m[6] * d[0] + m[7] * d[1] + m[8] * d[2]};
}

TEST(View, YawTurnsRightPitchRaisesAndRollLeansRight) {
  const Direction ahead = {0, 0, -1};
  const Direction up = {0, 1, 0};
  const auto near = [](const Direction& a, const Direction& b) { EXPECT_LT(difference(a, b), 1e-15); };
  near(seen(camera_rotation(0, 0, 0), {1, 2, 3}), {1, 2, 3});
  near(seen(camera_rotation(90, 0, 0), ahead), {1, 0, 0});
  near(seen(camera_rotation(90, 0, 0), up), up);
  near(seen(camera_rotation(0, 90, 0), ahead), up);
  near(seen(camera_rotation(0, 90, 0), up), {0, 0, 1});
  near(seen(camera_rotation(0, 0, 90), ahead), ahead);
  near(seen(camera_rotation(0, 0, 90), up), {1, 0, 0});  // its head leans to its right
  // Pitch raises along the direction of the yaw, and roll moves nothing that is ahead.
  near(seen(camera_rotation(90, 30, 0), ahead), {std::cos(kPi / 6), 0.5, 0});
  near(seen(camera_rotation(40, 20, 70), ahead), seen(camera_rotation(40, 20, 0), ahead));
}

TEST(View, ShowsTheSkyInTheDirectionsOfItsPixels) {
  Stage stage;
  stage.chain = cube_chain(cube_of(64, [](const Direction& d) { return d; }));
  Camera camera;
  camera.fov_deg = 70;
  camera.position = {100, -20, 3};  // the sky is infinitely far
  const Picture picture = picture_of(stage, camera, 60, 40);
  camera.rotation = camera_rotation(50, -20, 30);
  const Picture turned_picture = picture_of(stage, camera, 60, 40);
  for (uint32_t y = 0; y < 40; ++y) {
    for (uint32_t x = 0; x < 60; ++x) {
      const Direction d = ray(x + 0.5, y + 0.5, 60, 40, 70);
      EXPECT_LT(difference(picture[y][x], d), 0.005);
      EXPECT_LT(difference(turned_picture[y][x], seen(camera.rotation, d)), 0.005);
    }
  }
}

TEST(View, AnEnvironmentThatIsTurnedLeftIsSeenByACameraThatIsTurnedLeft) {
  const Scene panorama = random_panorama(32, 16, 8);
  Stage stage;
  stage.chain = cube_chain(cube_face(panorama, 16, 4, 0));
  for (const uint32_t size : {16u, 16u}) stage.specular.push_back(cube_face(panorama, size, 1, 0));
  stage.irradiance = irradiance_of(panorama_sh(panorama));
  for (BrdfSum& sum : stage.brdf) sum = {0.8, 0.1};
  stage.objects = {{{-0.7, 0, -3}, 0.6, {0.5, 0.7, 1}, 0.0, 0.4, true},
                   {{0.7, 0, -3}, 0.6, {1, 1, 1}, 1, 0, true}};
  const Picture straight = picture_of(stage, {}, 32, 24);
  stage.rotation_deg = 90;
  Camera camera{.rotation = camera_rotation(-90, 0, 0)};
  EXPECT_LT(difference(straight, picture_of(stage, camera, 32, 24)), 1e-12);
  EXPECT_GT(difference(straight, picture_of(stage, {}, 32, 24)), 0.1);
}

// --- levels of detail

TEST(View, TheSkyIsReadWhereATexelIsAsLargeAsAPixel) {
  Stage stage;
  stage.chain = lod_chain(256);
  stage.rotation_deg = 25;
  Camera camera{.rotation = camera_rotation(10, 35, 20), .fov_deg = 100};
  const Picture picture = picture_of(stage, camera, 64, 48);
  const double p = 2 * std::tan(50 * kPi / 180) / 48;
  for (uint32_t y = 0; y < 48; ++y) {
    for (uint32_t x = 0; x < 64; ++x) {
      const double pixel = patch((x + 0.5 - 32) * p, (23.5 - y) * p, p);
      const Direction d = turned_back(seen(camera.rotation, ray(x + 0.5, y + 0.5, 64, 48, 100)), 25);
      EXPECT_NEAR(picture[y][x][0], std::log2(pixel / texel_at(d, 256)) / 2, 0.01) << x << " " << y;
    }
  }
}

TEST(View, TheSkyIsReadAtLevelZeroWherePixelsAreSmall) {
  Stage stage;
  stage.chain = lod_chain(16);
  for (const auto& row : picture_of(stage, {}, 48, 32)) {
    for (const Rgb& c : row) EXPECT_EQ(c[0], 0.0);
  }
}

// The direction that the mirror sphere shows at (x, y) of a camera at `from` that is not turned.
std::optional<Direction> reflection(const Direction& from, double x, double y, uint32_t side,
                                    const Sphere& sphere) {
  const Direction d = ray(x, y, side, side, 60);
  const std::optional<double> at = trace(from, d, sphere);
  if (!at) return std::nullopt;
  Direction n;
  for (size_t k = 0; k < 3; ++k) n[k] = (from[k] + *at * d[k] - sphere.centre[k]) / sphere.radius;
  const double twice = 2 * dot3(n, d);
  if (-dot3(n, d) < 0.05) return std::nullopt;  // too near the edge for differences
  return Direction{d[0] - twice * n[0], d[1] - twice * n[1], d[2] - twice * n[2]};
}

TEST(View, AMirrorSphereSpreadsAPixelAsItsReflectionsSay) {
  const Sphere sphere = mirror({1.2, 0.9, -4}, 1.0);
  Stage stage = mirror_stage({sphere});
  stage.chain = lod_chain(256);
  Camera camera{.position = {0.5, 0.3, 1}};
  const Picture picture = picture_of(stage, camera, 64, 64);
  int compared = 0;
  for (uint32_t y = 0; y < 64; ++y) {
    for (uint32_t x = 0; x < 64; ++x) {
      constexpr double kStep = 1e-4;
      const auto at = [&](double dx, double dy) {
        return reflection(camera.position, x + 0.5 + dx, y + 0.5 + dy, 64, sphere);
      };
      const auto [r, left, right, above, below] =
          std::array{at(0, 0), at(-kStep, 0), at(kStep, 0), at(0, -kStep), at(0, kStep)};
      if (!r || !left || !right || !above || !below) continue;
      Direction a;
      Direction b;
      for (size_t k = 0; k < 3; ++k) {
        a[k] = ((*right)[k] - (*left)[k]) / (2 * kStep);
        b[k] = ((*below)[k] - (*above)[k]) / (2 * kStep);
      }
      const double area2 = dot3(a, a) * dot3(b, b) - dot3(a, b) * dot3(a, b);
      EXPECT_NEAR(picture[y][x][0], std::log2(std::sqrt(area2) / texel_at(*r, 256)) / 2, 0.01)
          << x << " " << y;
      ++compared;
    }
  }
  EXPECT_GT(compared, 300);
}

// --- samples

TEST(View, PixelsOnAnEdgeAreTheMeanOfTheirRays) {
  const Sphere sphere = flat({0.2, 0.1, -3}, 1, {1, 1, 1});
  const Stage stage = flat_stage({sphere});
  const Picture single = picture_of(stage, {}, 32, 32);
  for (const uint32_t grid : {2u, 4u}) {
    const Picture picture = picture_of(stage, {}, 32, 32, grid * grid);
    int mixed = 0;
    for (uint32_t y = 0; y < 32; ++y) {
      for (uint32_t x = 0; x < 32; ++x) {
        uint32_t hits = 0;
        for (uint32_t k = 0; k < grid * grid; ++k) {
          const Direction d = ray(x + (k % grid + 0.5) / grid, y + (k / grid + 0.5) / grid, 32, 32, 60);
          hits += trace({}, d, sphere).has_value();
        }
        EXPECT_NEAR(picture[y][x][0], static_cast<double>(hits) / (grid * grid), 1e-14) << x << " " << y;
        const bool all_alike = hits == 0 || hits == grid * grid;
        if (all_alike) {
          EXPECT_EQ(picture[y][x], single[y][x]);
        }
        mixed += !all_alike;
      }
    }
    EXPECT_GT(mixed, 20);
  }
}

TEST(View, PixelsInsideAnObjectHaveTheirCentresValue) {
  // The sky and the reflections differ from one ray to the next, so a mean would show.
  Stage stage = mirror_stage({mirror({0, 0, -3}, 1)});
  stage.chain = cube_chain(cube_face(random_panorama(64, 32, 9), 16, 4, 0));
  const Picture single = picture_of(stage, {}, 32, 32);
  for (const uint32_t samples : {4u, 16u}) {
    const Picture picture = picture_of(stage, {}, 32, 32, samples);
    int different = 0;
    for (uint32_t y = 0; y < 32; ++y) {
      for (uint32_t x = 0; x < 32; ++x) {
        const double distance = std::hypot(x + 0.5 - 16, y + 0.5 - 16);
        // The ball's image has a radius of 32 / (2 tan 30) / sqrt(9 - 1) = 9.8 pixels.
        if (std::abs(distance - 9.8) > 0.8) {
          EXPECT_EQ(picture[y][x], single[y][x]) << x << " " << y;
        }
        different += picture[y][x] != single[y][x];
      }
    }
    EXPECT_GT(different, 20);
  }
}

TEST(View, EveryRayOfAPixelHasThePixelsFootprint) {
  // A pixel with a hit and fifteen misses: the sky's lod is the centre's within the pixel.
  Stage stage = flat_stage({flat({0, 0, -3}, 1, {0, 0, 0})});
  stage.chain = lod_chain(256);
  Camera camera{.fov_deg = 120};
  const Picture picture = picture_of(stage, camera, 24, 24, 16);
  const double lod = std::log2(2 * std::tan(kPi / 3) / 24 * 256 / 2);
  bool found = false;
  for (uint32_t x = 0; x < 24; ++x) {
    const Direction from_left = ray(x + 0.125, 11.875, 24, 24, 120);
    const Direction from_right = ray(x + 0.875, 11.875, 24, 24, 120);
    if (trace({}, from_left, stage.objects[0]).has_value() ==
        trace({}, from_right, stage.objects[0]).has_value()) {
      continue;
    }
    found = true;
    int misses = 0;
    for (uint32_t k = 0; k < 16; ++k) {
      const Direction d = ray(x + (k % 4 + 0.5) / 4, 11 + (k / 4 + 0.5) / 4, 24, 24, 120);
      misses += !trace({}, d, stage.objects[0]).has_value();
    }
    // c / m is 1 because the view's axis is -Z.
    EXPECT_NEAR(picture[11][x][0], lod * misses / 16, 1e-12);
  }
  EXPECT_TRUE(found);
}

TEST(View, SaysWhichPixelsHaveARayNearAnEdge) {
  for (const uint32_t samples : {1u, 4u, 16u}) {
    // The centre's ray of pixel (20, 9), and a ray of the grid of 4 in pixel (21, 9).
    for (const auto& [x, grid_ray] : {std::pair{20.5, false}, {21.25, true}}) {
      const Direction d = ray(x, grid_ray ? 9.75 : 9.5, 32, 32, 60);
      const double along = -3 * d[2];
      const double distance = std::sqrt(9 - along * along);
      for (const auto& [factor, near] :
           {std::pair{1 + 0.9e-4, true}, {1 - 0.9e-4, true}, {1 + 1.1e-4, false}, {1 - 1.1e-4, false}}) {
        const Stage stage = flat_stage({flat({0, 0, -3}, distance * factor, kRed)});
        std::vector<bool> near_edge;
        view_row(stage.scene(), {}, 32, 32, samples, 9, &near_edge);
        ASSERT_EQ(near_edge.size(), 32u);
        const bool has_ray = !grid_ray || samples == 4;
        EXPECT_EQ(near_edge[static_cast<size_t>(x)], near && has_ray) << samples << " " << x << " " << factor;
        EXPECT_FALSE(near_edge[3]);
      }
    }
  }
}

}  // namespace
}  // namespace candela
