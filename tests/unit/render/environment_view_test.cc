// The float64 reference of views: cameras, the sky, and spheres before it.
#include <gtest/gtest.h>

#include <algorithm>
#include <optional>
#include <vector>

#include "tests/unit/render/environment_support.h"

namespace candela::reference {
namespace {

// A scene that owns what a ViewScene refers to. Without changes it is black.
struct Stage {
  std::vector<CubeLevel> chain = cube_chain(cube_of(16, [](const Direction&) { return Rgb{}; }));
  std::vector<CubeLevel> specular = {chain[0]};
  Harmonics irradiance{};
  std::vector<BrdfSum> brdf = std::vector<BrdfSum>(128 * 128);
  double rotation_deg = 0.0;
  std::vector<Sphere> objects;

  ViewScene scene() const { return {chain, specular, irradiance, brdf, rotation_deg, objects}; }
};

constexpr Rgb kRed = {1, 0, 0};
constexpr Rgb kGreen = {0, 1, 0};

using Picture = std::vector<std::vector<Rgb>>;

Picture picture_of(const Stage& stage, const Camera& camera, uint32_t width, uint32_t height,
                   uint32_t samples = 1) {
  Picture rows;
  for (uint32_t y = 0; y < height; ++y) {
    rows.push_back(view_row(stage.scene(), camera, width, height, samples, y));
  }
  return rows;
}

// What the camera sees ahead of it.
Rgb middle_of(const Stage& stage) { return view_row(stage.scene(), {}, 5, 5, 1, 2)[2]; }

double difference(const Picture& a, const Picture& b) {
  double worst = 0.0;
  for (size_t y = 0; y < a.size(); ++y) {
    for (size_t x = 0; x < a[y].size(); ++x) worst = std::max(worst, candela::difference(a[y][x], b[y][x]));
  }
  return worst;
}

// A sphere that is its base_color wherever it is seen: the irradiance is pi and it has no highlight.
Sphere flat(const Direction& centre, double radius, const Rgb& color) {
  return {centre, radius, color, 0, 0.5, false};
}

// For flat spheres before a black sky.
Stage flat_stage(std::vector<Sphere> objects) {
  Stage stage;
  for (double& c : stage.irradiance[0]) c = kPi * std::sqrt(4 * kPi);
  stage.objects = std::move(objects);
  return stage;
}

// A stage whose spheres of metallic 1 are mirrors without loss.
Stage mirror_stage(std::vector<Sphere> objects) {
  Stage stage;
  for (BrdfSum& sum : stage.brdf) sum = {1.0, 0.0};
  stage.objects = std::move(objects);
  return stage;
}

Sphere mirror(const Direction& centre, double radius, double roughness = 0.0) {
  return {centre, radius, {1, 1, 1}, 1, roughness, false};
}

// The ray through (x, y) of a camera that is not turned.
Direction ray(double x, double y, uint32_t width, uint32_t height, double fov_deg) {
  const double half_height = std::tan(fov_deg * kPi / 360);
  return unit({(2 * x / width - 1) * half_height * width / height, (1 - 2 * y / height) * half_height, -1});
}

// The distance at which a ray from `from` with length 1 meets a sphere.
std::optional<double> trace(const Direction& from, const Direction& d, const Sphere& sphere) {
  const Direction to = {sphere.centre[0] - from[0], sphere.centre[1] - from[1], sphere.centre[2] - from[2]};
  const double b = dot3(to, d);
  const double root = b * b - dot3(to, to) + sphere.radius * sphere.radius;
  if (b <= 0 || root < 0) return std::nullopt;
  return b - std::sqrt(root);
}

// Level k is k everywhere, so a picture is the level of detail.
std::vector<CubeLevel> lod_chain(uint32_t size) {
  std::vector<CubeLevel> chain;
  for (; size > 0; size /= 2) {
    const auto lod = static_cast<double>(chain.size());
    chain.push_back(CubeLevel{size, std::vector<Rgb>(6 * size * size, Rgb{lod, lod, lod})});
  }
  return chain;
}

// The solid angle of the rectangle (x +- side/2, y +- side/2) in the plane at the distance 1.
double patch(double x, double y, double side) {
  const auto corner = [](double s, double t) { return std::atan2(s * t, std::sqrt(s * s + t * t + 1)); };
  const double h = side / 2;
  return corner(x + h, y + h) - corner(x - h, y + h) - corner(x + h, y - h) + corner(x - h, y - h);
}

// The solid angle of a texel whose centre is in direction d.
double texel_at(const Direction& d, uint32_t size) {
  const CubeSpot spot = cube_spot(d);
  return patch(spot.s, spot.t, 2.0 / size);
}

}  // namespace
}  // namespace candela::reference

namespace candela {
namespace {

// The float64 reference of views (docs/environments.md, section 6), against geometry that is computed here in
// another way: the camera, the sky and the rays of a pixel.

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

// The float64 reference of views (docs/environments.md, section 6): what a ray meets and what it reflects.

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
