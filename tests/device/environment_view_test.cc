// Views of environments, and their float64 twins.
#include <half.h>

#include "server/render/frame/frame_textures.h"
#include "server/render/host/host_executor.h"
#include "tests/device/environment_fixture.h"
#include "tests/support/status.h"

namespace candela::testing {
namespace {

struct Picture {
  uint32_t width = 0;
  uint32_t height = 0;
  std::vector<std::array<float, 4>> texels;
};

// What the twin looks at: what the device has baked.
struct TwinStage {
  std::vector<reference::CubeLevel> chain;
  std::vector<reference::CubeLevel> specular;
  std::vector<reference::BrdfSum> brdf;
  std::vector<reference::Sphere> objects;
  reference::ViewScene scene;
};

// Grey, the largest magnitude among each texel and its neighbours, also across edges.
reference::CubeLevel bound_of(const reference::CubeLevel& level) {
  reference::CubeLevel out = level;
  for (uint32_t at = 0; at < level.texels.size(); ++at) {
    const uint32_t face = at / (level.size * level.size), j = at / level.size % level.size,
                   i = at % level.size;
    double most = 0;
    for (int b = -1; b <= 1; ++b) {
      for (int a = -1; a <= 1; ++a) {
        const double s = (2.0 * (static_cast<int>(i) + a) + 1) / level.size - 1;
        const double t = (2.0 * (static_cast<int>(j) + b) + 1) / level.size - 1;
        const NearestTexel n = nearest_texel(reference::cube_point({face, s, t}), level.size);
        most = std::max(most, largest(level.at(n.face, n.i, n.j)));
      }
    }
    out.texels[at] = {most, most, most};
  }
  return out;
}

class EnvironmentViewTest : public ::testing::TestWithParam<MachineKind> {
 protected:
  void SetUp() override {
    const std::string why = HostExecutor::unavailable(machine().device->summary());
    if (GetParam() == MachineKind::kHost && !why.empty()) GTEST_SKIP() << why;
  }

  Machine& machine() { return Machine::of(GetParam()); }
  EnvironmentBaker& baker() { return *machine().baker; }

  Environment ready(const WireFrame& frame) {
    Environment environment = environment_of(baker(), frame);
    EXPECT_OK(baker().prepare_view(environment, kDraft));
    return environment;
  }

  FrameMemory memory_for(uint32_t width, uint32_t height, Verify verify = Verify::kNo) {
    absl::StatusOr<FrameMemory> memory =
        machine().renderer->allocate({width, height, v1::PIXEL_FORMAT_RGBA16F}, *Settings::from({}), verify);
    EXPECT_OK(memory);
    return *std::move(memory);
  }

  Picture render(Environment& environment, const View& view, uint32_t width, uint32_t height) {
    FrameMemory memory = memory_for(width, height);
    EXPECT_OK(baker().render_view(environment, view, memory));
    Picture picture{width, height, {}};
    for (uint32_t y = 0; y < height; ++y) {
      const auto* halves = reinterpret_cast<const uint16_t*>(memory.input_row(y).data());
      for (uint32_t x = 0; x < width; ++x, halves += 4) {
        picture.texels.push_back({imath_half_to_float(halves[0]), imath_half_to_float(halves[1]),
                                  imath_half_to_float(halves[2]), imath_half_to_float(halves[3])});
      }
    }
    return picture;
  }

  std::unique_ptr<TwinStage> stage_of(Environment& environment, const View& view) {
    auto stage = std::make_unique<TwinStage>();
    stage->chain = levels_of(baker(), environment.view.chain);
    stage->specular = levels_of(baker(), environment.view.specular);
    stage->specular.insert(stage->specular.begin(), stage->chain[0]);
    const std::span<const uint16_t> table = *baker().brdf_table();
    for (size_t i = 0; i < table.size(); i += 2) {
      stage->brdf.push_back({imath_half_to_float(table[i]), imath_half_to_float(table[i + 1])});
    }
    for (const ViewSphere& s : view.objects) {
      stage->objects.push_back(
          {s.centre, s.radius, s.base_color, s.metallic, s.roughness, s.fixed_to_camera});
    }
    stage->scene = {stage->chain, stage->specular,   irradiance_of(*baker().radiance(environment)),
                    stage->brdf,  view.rotation_deg, stage->objects};
    return stage;
  }

  void expect_twin(Environment& environment, const View& view, uint32_t width, uint32_t height,
                   const std::string& what);
};

// Each pixel within 2^-10 of the largest texels that it uses, beside the rounding to halves.
void EnvironmentViewTest::expect_twin(Environment& environment, const View& view, uint32_t width,
                                      uint32_t height, const std::string& what) {
  const Picture is = render(environment, view, width, height);
  const std::unique_ptr<TwinStage> stage = stage_of(environment, view);
  TwinStage most = *stage;
  for (reference::CubeLevel& level : most.chain) level = bound_of(level);
  for (reference::CubeLevel& level : most.specular) level = bound_of(level);
  most.scene.chain = most.chain;
  most.scene.specular = most.specular;
  double all = 0;
  for (const auto& c : stage->scene.irradiance) all += largest(c);
  most.scene.irradiance = {};
  most.scene.irradiance[0] = {all, all, all};
  const reference::Camera camera = {view.camera.rotation, view.camera.position, view.camera.fov_deg};
  size_t near = 0;
  for (uint32_t y = 0; y < height; ++y) {
    std::vector<bool> near_edge;
    const auto should = view_row(stage->scene, camera, width, height, view.samples, y, &near_edge);
    const auto bound = view_row(most.scene, camera, width, height, view.samples, y);
    for (uint32_t x = 0; x < width; ++x) {
      const std::array<float, 4>& texel = is.texels[size_t{y} * width + x];
      ASSERT_EQ(texel[3], 1.0f);
      near += near_edge[x];
      for (size_t k = 0; k < 3 && !near_edge[x]; ++k) {
        const double clamped = std::clamp(should[x][k], -65504.0, 65504.0);
        ASSERT_NEAR(texel[k], clamped, largest(bound[x]) / 1024 + std::abs(clamped) / 2048 + 3e-8)
            << what << " pixel " << x << ", " << y;
      }
    }
  }
  EXPECT_LE(near, 4 + size_t{width} * height / 50) << what;
}

View turned_view(double yaw, double pitch, double roll, double fov_deg) {
  View view;
  view.camera.rotation = camera_rotation(yaw, pitch, roll);
  view.camera.fov_deg = fov_deg;
  return view;
}

std::vector<WireFrame> panoramas_to_view() {
  return {natural(1, 1),     natural(2, 1),  natural(3, 2),  natural(97, 41),
          natural(512, 256), natural(1, 64), sun_at(160, 38)};
}

// Views of environments on the device and on the host, against their float64 twin and as frames.

INSTANTIATE_TEST_SUITE_P(On, EnvironmentViewTest,
                         ::testing::Values(MachineKind::kUnified, MachineKind::kStaging, MachineKind::kHost),
                         [](const auto& kind) { return kMachineWords[static_cast<uint32_t>(kind.param)]; });

TEST_P(EnvironmentViewTest, TheSkyIsItsTwins) {
  for (const WireFrame& frame : panoramas_to_view()) {
    Environment environment = ready(frame);
    for (const double fov_deg : {1.0, 60.0, 170.0}) {
      View view = turned_view(200, -35, 15, fov_deg);
      view.rotation_deg = 33;
      expect_twin(environment, view, 61, 35, name_of(frame) + " fov " + std::to_string(fov_deg));
    }
    expect_twin(environment, turned_view(0, 90, 0, 90), 40, 40, name_of(frame) + " zenith");
    expect_twin(environment, turned_view(0, -90, 0, 90), 40, 40, name_of(frame) + " nadir");
    expect_twin(environment, turned_view(45, -35.26, 0, 20), 33, 9, name_of(frame) + " a corner of the cube");
    expect_twin(environment, turned_view(0, 0, 0, 60), 1, 1, name_of(frame) + " one pixel");
  }
}

// At a pole, on the seam, on an edge of the cube and in its corner.
TEST_P(EnvironmentViewTest, SunsWherePanoramasAndCubesMeetThemselvesAreTheTwins) {
  for (const auto& [x, y] : std::vector<std::array<uint32_t, 2>>{{40, 0}, {255, 50}, {160, 64}, {160, 38}}) {
    const std::string what = "sun " + std::to_string(x) + ", " + std::to_string(y);
    Environment environment = ready(sun_at(x, y));
    const double yaw = 360 * ((x + 0.5) / kSunWidth - 0.5), pitch = 180 * (0.5 - (y + 0.5) / kSunHeight);
    for (const double fov_deg : {6.0, 100.0}) {
      const View view = turned_view(yaw, pitch, 10, fov_deg);
      expect_twin(environment, view, 45, 33, what + " fov " + std::to_string(fov_deg));
      EXPECT_GT(render(environment, view, 45, 33).texels[16 * 45 + 22][0], 1) << what;
    }
    View behind = turned_view(yaw + 180, -pitch, 0, 40);
    behind.samples = 4;
    behind.objects = lookdev_objects();
    expect_twin(environment, behind, 128, 40, what + " behind the camera");
  }
}

// The sky's work groups read one level or two, here beside each other.
TEST_P(EnvironmentViewTest, ASkyThatIsPartlyMagnifiedIsItsTwin) {
  Environment environment = ready(natural(512, 256));
  for (const double fov_deg : {20.0, 22.0, 25.0}) {
    expect_twin(environment, turned_view(20, 15, 30, fov_deg), 780, 45, std::to_string(fov_deg));
  }
}

// The shader rounds and packs halves itself, and the host's registers have conversions of their own.
TEST_P(EnvironmentViewTest, AFlatSkyKeepsItsBits) {
  for (const float value : {0.0f, 0x1p-24f, -0x1p-24f, 0x1.8p-23f, 0x1.ff8p-15f, -0x1.ffp-15f, 0x1p-14f,
                            0x1.004p-14f, -0.333251953125f, 1.0f, 65504.0f, -65504.0f}) {
    Environment environment = ready(flat(8, 4, {value, value / 2, -value, 1}));
    for (const double fov_deg : {60.0, 170.0}) {
      for (const auto& texel : render(environment, turned_view(40, 30, 0, fov_deg), 9, 5).texels) {
        EXPECT_EQ(texel[0], value);
        EXPECT_EQ(texel[1], imath_half_to_float(imath_float_to_half(value / 2)));
        EXPECT_EQ(texel[2], -value);
        EXPECT_EQ(texel[3], 1.0f);
      }
    }
  }
}

TEST_P(EnvironmentViewTest, TheSameViewHasTheSameBitsAndItsFrameIsThatOfTheSamePixels) {
  Environment environment = ready(natural(97, 41));
  View view = turned_view(10, 0, 0, 50);
  view.objects = lookdev_objects();
  FrameMemory by_view = memory_for(97, 55, Verify::kYes), again = memory_for(97, 55);
  FrameMemory by_wire = memory_for(97, 55);
  ASSERT_OK(baker().render_view(environment, view, by_view));
  ASSERT_OK(baker().render_view(environment, view, again));
  for (uint32_t y = 0; y < 55; ++y) {
    const auto row = by_view.input_row(y);
    EXPECT_EQ(std::memcmp(row.data(), again.input_row(y).data(), row.size()), 0) << "row " << y;
    std::memcpy(by_wire.input_row(y).data(), row.data(), row.size());
  }
  const Settings settings = *Settings::from({});
  ASSERT_OK_AND_ASSIGN(const auto report, machine().renderer->render(by_view, settings));
  ASSERT_OK(machine().renderer->render(by_wire, settings));
  for (uint32_t y = 0; y < 55; ++y) {
    const auto row = by_view.output_row(y);
    EXPECT_EQ(std::memcmp(row.data(), by_wire.output_row(y).data(), row.size()), 0) << "row " << y;
  }
  // The float64 reference has seen the same pixels.
  EXPECT_LE(report.verification->rounded.max_codes, 1.0);
}

TEST_P(EnvironmentViewTest, TheSkyNeedsNoSpecularLevelsAndObjectsAddThem) {
  const WireFrame frame = natural(256, 128);
  Environment whole = ready(frame);
  Environment grown = environment_of(baker(), frame);
  ASSERT_OK(baker().prepare_view(grown, kDraft, /*objects=*/false));
  EXPECT_LT(grown.view.bytes(), whole.view.bytes());
  const View sky = turned_view(20, 10, 0, 60);
  EXPECT_EQ(render(grown, sky, 40, 30).texels, render(whole, sky, 40, 30).texels);
  View objects = sky;
  objects.objects = lookdev_objects();
  FrameMemory memory = memory_for(8, 8);
  EXPECT_EQ(baker().render_view(grown, objects, memory).code(), absl::StatusCode::kFailedPrecondition);
  ASSERT_OK(baker().prepare_view(grown, kDraft));
  EXPECT_EQ(grown.view.bytes(), whole.view.bytes());
  EXPECT_EQ(render(grown, objects, 40, 30).texels, render(whole, objects, 40, 30).texels);
}

TEST_P(EnvironmentViewTest, WhatCannotBeRenderedIsRefusedByName) {
  Environment environment = environment_of(baker(), natural(16, 8));
  FrameMemory memory = memory_for(8, 8);
  EXPECT_EQ(baker().render_view(environment, {}, memory).code(), absl::StatusCode::kFailedPrecondition);
  ASSERT_OK(baker().prepare_view(environment, kDraft));
  const auto of_spheres = [](size_t count, const ViewSphere& sphere) {
    View view;
    view.objects.assign(count, sphere);
    return view;
  };
  View two_samples;
  two_samples.samples = 2;
  const std::pair<View, const char*> table[] = {
      {two_samples, "view.samples is 2; it must be 1, 4 or 16"},
      {turned_view(0, 0, 0, 171), "view.camera.fov_deg is 171; it must be 1 .. 170"},
      {of_spheres(1, {{0, 0, -0.5}, 0.5, {1, 1, 1}, 0, 0, false}), "the camera is in view.objects[0]"},
      {of_spheres(1, {{0, 0, -5}, 0, {1, 1, 1}, 0, 0, false}),
       "view.objects[0].radius is 0; it must be above 0"},
      {of_spheres(1, {{0, 0, -5}, 1, {1, 2, 1}, 0, 0, false}),
       "view.objects[0].base_color is 2; it must be 0 .. 1"},
      {of_spheres(65, {{0, 0, -5}, 1, {1, 1, 1}, 0, 0, false}),
       "view.objects has 65 spheres; at most 64 are possible"}};
  for (const auto& [view, words] : table)
    EXPECT_REFUSED(kInvalidArgument, words, baker().render_view(environment, view, memory));
  EXPECT_FALSE(camera_rotation({0, 0, 0, 1.1}).ok());
}

TEST(ViewCamera, AQuaternionAndAnglesThatSayTheSameTurnTheSame) {
  const double half = 35.0 * 3.14159265358979323846 / 360;
  ASSERT_OK_AND_ASSIGN(const auto by_quaternion, camera_rotation({0, std::sin(-half), 0, std::cos(-half)}));
  const Matrix3 by_angles = camera_rotation(35, 0, 0);
  const reference::Rotation twins = reference::camera_rotation(10, 20, 30);
  const Matrix3 own = camera_rotation(10, 20, 30);
  for (size_t i = 0; i < 9; ++i) {
    EXPECT_NEAR(by_quaternion[i], by_angles[i], 1e-12);
    EXPECT_NEAR(own[i], twins[i], 1e-12);
  }
}

// Views of spheres in an environment, on the device and on the host, against their float64 twin.

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
