// Views of environments on the device and on the host, against their float64 twin and as frames.
#include "tests/device/environments/environment_view_fixture.h"
#include "tests/support/status.h"

namespace candela::testing {
namespace {

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

}  // namespace
}  // namespace candela::testing
