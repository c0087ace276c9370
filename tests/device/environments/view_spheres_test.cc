// Views of spheres in an environment, on the device and on the host, against their float64 twin.
#include "tests/device/environments/environment_view_fixture.h"

namespace candela::testing {
namespace {

TEST_P(EnvironmentViewTest, LookdevIsItsTwins) {
  for (const WireFrame& frame : panoramas_to_view()) {
    Environment environment = ready(frame);
    for (const uint32_t samples : {1u, 4u, 16u}) {
      View view = turned_view(70, 10, 5, 40);
      view.rotation_deg = -120;
      view.samples = samples;
      view.objects = lookdev_objects();
      expect_twin(environment, view, 128, 40, name_of(frame) + " samples " + std::to_string(samples));
    }
  }
}

constexpr std::array<double, 3> kCameraAmongSpheres = {0, 0, 5};

// As many as there may be, of every kind, some behind each other, some in each other, some behind the camera
// at kCameraAmongSpheres.
std::vector<ViewSphere> many_spheres() {
  std::vector<ViewSphere> all;
  for (uint32_t i = 0; i < shader::VIEW_OBJECTS; ++i) {
    const auto random = [i](uint32_t channel) { return static_cast<double>(noise(i, 17, channel)); };
    ViewSphere sphere;
    sphere.centre = {8 * random(0) - 4, 6 * random(1) - 3, 9 - 19 * random(2)};
    sphere.radius = 0.1 + 0.8 * random(3);
    sphere.base_color = {random(4), random(5), random(6)};
    sphere.metallic = i % 3 / 2.0;
    sphere.roughness = i % 5 / 4.0;
    const double away =
        std::hypot(sphere.centre[0], sphere.centre[1], sphere.centre[2] - kCameraAmongSpheres[2]);
    if (away > sphere.radius + 0.2) all.push_back(sphere);
  }
  return all;
}

TEST_P(EnvironmentViewTest, ManySpheresAreTheTwins) {
  Environment environment = ready(natural(512, 256));
  View view = turned_view(-10, 5, 20, 75);
  view.camera.position = kCameraAmongSpheres;
  view.objects = many_spheres();
  const auto is_behind = [](const ViewSphere& s) { return s.centre[2] > kCameraAmongSpheres[2] + s.radius; };
  EXPECT_GT(std::count_if(view.objects.begin(), view.objects.end(), is_behind), 5);
  for (const uint32_t samples : {1u, 16u}) {
    view.samples = samples;
    expect_twin(environment, view, 111, 63, "samples " + std::to_string(samples));
  }
}

ViewSphere sphere_of(double x, double y, double z, double radius, double metallic = 0.5,
                     double roughness = 0.4) {
  return {{x, y, z}, radius, {0.9, 0.5, 0.2}, metallic, roughness, false};
}

std::vector<ViewSphere> under_a_pixel() {
  std::vector<ViewSphere> all;
  for (int i = 0; i < 64; ++i)
    all.push_back(sphere_of(3 * std::sin(i), 1.5 * std::cos(3 * i), -5, 0.01 + 0.0005 * i));
  return all;
}

struct HardSpheres {
  const char* name;
  View view;
  std::vector<ViewSphere> objects;
  // How many pixels show an object at least and at most.
  size_t least;
  size_t most;
  Size size = {64, 48};
};

TEST_P(EnvironmentViewTest, SpheresThatAreHardToMeetAreTheTwins) {
  Environment environment = ready(natural(256, 128));
  const HardSpheres table[] = {
      {"behind",
       turned_view(0, 0, 0, 120),
       {sphere_of(0, 0, 3, 1), sphere_of(0, 0, 1.001, 1), sphere_of(2, -1, 1.2, 1.1),
        sphere_of(0, 1e4, 2e4, 1e4)},
       0,
       0},
      // Their centres are behind the camera, and parts of them before it.
      {"beside",
       turned_view(0, 0, 0, 170),
       {sphere_of(1.5, 0, 0.3, 1.4), sphere_of(-1.01, 0, 0.01, 1, 1, 0)},
       1000,
       3000},
      {"under a pixel", turned_view(0, 0, 0, 60), under_a_pixel(), 20, 150},
      // The camera is just outside the sphere.
      {"all over", turned_view(0, 0, 15, 100), {sphere_of(0, 0, -1.0005, 1, 1, 0)}, 64 * 48, 64 * 48},
      {"all over, rough",
       turned_view(0, 0, 15, 100),
       {sphere_of(0, 0, -1.0005, 1, 1, 0.5)},
       64 * 48,
       64 * 48},
      // In each other, around each other, and two at one place, of which the first is seen.
      {"overlapping",
       turned_view(0, 0, 0, 60),
       {sphere_of(-1, 0, -4, 0.8), sphere_of(-0.5, 0.3, -4.2, 0.9, 1, 0.1), sphere_of(1, 0, -4, 0.5),
        sphere_of(1, 0, -4, 0.9, 1, 0), sphere_of(0, -1, -4, 0.6), sphere_of(0, -1, -4, 0.6, 1, 0)},
       500,
       1200},
      // Straight down, with spheres below the camera and one above it.
      {"below",
       turned_view(20, -90, 0, 90),
       {sphere_of(0, -2, 0, 0.5, 1, 0), sphere_of(1.5, -3, 1, 1, 0, 1), sphere_of(0, 2, 0, 1)},
       200,
       500},
      // The rays of the tile in the middle go to more than half of all directions.
      {"in a wide tile", turned_view(0, 0, 0, 170), {sphere_of(1.92, 1.92, -2.94, 0.5)}, 1, 60, {61, 35}},
  };
  for (const auto& [name, sky, objects, least, most, size] : table) {
    const Picture without = render(environment, sky, size.width, size.height);
    View view = sky;
    view.objects = objects;
    for (const uint32_t samples : {1u, 16u}) {
      view.samples = samples;
      expect_twin(environment, view, size.width, size.height,
                  std::string(name) + " samples " + std::to_string(samples));
    }
    const Picture with = render(environment, view, size.width, size.height);
    size_t shown = 0;
    for (size_t i = 0; i < with.texels.size(); ++i) shown += with.texels[i] != without.texels[i];
    EXPECT_GE(shown, least) << name;
    EXPECT_LE(shown, most) << name;
  }
}

// Work groups draw VIEW_TILE or VIEW_SKY_X columns. The spheres are on their borders, and one beyond the
// picture.
TEST_P(EnvironmentViewTest, SpheresAtTheBordersOfWorkGroupsAreTheTwins) {
  Environment environment = ready(natural(512, 256));
  constexpr uint32_t kWidth = 2 * shader::VIEW_SKY_X + 5, kHeight = 3 * shader::VIEW_TILE + 1;
  View view = turned_view(30, 10, 0, 30);
  const double p = 2 * std::tan(15 * 3.14159265358979323846 / 180) / kHeight;
  uint32_t kind = 0;
  for (const uint32_t x : {0u, 8u, 256u, 384u, 512u, kWidth, kWidth + 9}) {
    for (const uint32_t y : {0u, 8u, 16u, kHeight}) {
      const double right = (x - kWidth / 2.0) * p, up = (kHeight / 2.0 - y) * p;
      ViewSphere sphere = {{3 * right, 3 * up, -3}, 3 * p * (0.6 + kind % 4), {0.9, 0.5, 0.2}};
      sphere.metallic = kind % 2;
      sphere.roughness = kind % 5 / 4.0;
      sphere.fixed_to_camera = true;
      view.objects.push_back(sphere);
      ++kind;
    }
  }
  for (const uint32_t samples : {1u, 4u}) {
    view.samples = samples;
    expect_twin(environment, view, kWidth, kHeight, "samples " + std::to_string(samples));
  }
}

TEST_P(EnvironmentViewTest, TilesThatAreTakenForSkyMissNoObject) {
  // A sphere that is seen larger than its own cone says only if the cone is wrong: at the rim of a wide view.
  Environment environment = ready(flat(8, 4, {1, 1, 1, 1}));
  for (const double fov_deg : {30.0, 120.0, 170.0}) {
    View view = turned_view(0, 0, 0, fov_deg);
    for (int i = 0; i < 40; ++i) {
      ViewSphere sphere;
      const double angle = (i - 20) * 0.075;
      sphere.centre = {4 * std::sin(angle), 2 * std::sin(0.9 * i), -4 * std::cos(angle)};
      sphere.radius = 0.05 + 0.01 * i;
      sphere.base_color = {0, 0, 0};
      sphere.roughness = 1;
      view.objects.push_back(sphere);
    }
    expect_twin(environment, view, 201, 120, std::to_string(fov_deg));
  }
}

TEST_P(EnvironmentViewTest, AWhiteMatteBallInAWhiteFieldIsNearlyInvisible) {
  Environment environment = ready(flat(64, 32, {1, 1, 1, 1}));
  View view = turned_view(0, 0, 0, 60);
  view.objects = {{{0, 0, -3}, 1, {1, 1, 1}, 0, 1, false}};
  for (const auto& texel : render(environment, view, 64, 64).texels) {
    for (size_t k = 0; k < 3; ++k) EXPECT_NEAR(texel[k], 1.0, 2e-3);
  }
}

TEST_P(EnvironmentViewTest, ARoughBallInASmallPanoramaIsNoMirror) {
  Environment environment = ready(make_frame(16, 8, v1::PIXEL_FORMAT_RGBA16F, [](uint32_t x, uint32_t) {
    return x < 8 ? Texel{0, 0, 0, 1} : Texel{1, 1, 1, 1};
  }));
  View view = turned_view(0, 0, 0, 20);
  view.objects = {{{0, 0, -3}, 1, {1, 1, 1}, 1, 1, false}};
  const Picture picture = render(environment, view, 64, 64);
  const auto row = picture.texels.begin() + 32 * 64;
  for (int x = 1; x < 64; ++x) EXPECT_LT(row[x][0] - row[x - 1][0], 0.1) << x;
  EXPECT_GT(row[63][0], row[0][0] + 0.2);
}

}  // namespace
}  // namespace candela::testing
