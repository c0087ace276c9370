// What a view of an environment shows: a camera and spheres (docs/environments.md section 6). Pure.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "absl/status/statusor.h"

namespace candela {

using Vector3 = std::array<double, 3>;
using Matrix3 = std::array<double, 9>;  // row by row

struct ViewCamera {
  Matrix3 rotation{1, 0, 0, 0, 1, 0, 0, 0, 1};  // camera to world
  Vector3 position{};
  double fov_deg = 60.0;  // vertical, 1 .. 170
};

struct ViewSphere {
  Vector3 centre{};  // in world axes; if fixed_to_camera in camera axes, from the camera
  double radius = 0.5;
  Vector3 base_color{1, 1, 1};
  double metallic = 0.0;
  double roughness = 0.0;
  bool fixed_to_camera = false;
};

struct View {
  ViewCamera camera;
  std::vector<ViewSphere> objects;  // at most shader::VIEW_OBJECTS
  uint32_t samples = 1;             // 1, 4 or 16
  double rotation_deg = 0.0;        // of the environment
};

// Turns about the camera's own axes: yaw to the right, pitch up, roll to the right.
Matrix3 camera_rotation(double yaw_deg, double pitch_deg, double roll_deg);
// From x, y, z, w. INVALID_ARGUMENT if the length is not 1 within 1e-3.
absl::StatusOr<Matrix3> camera_rotation(const std::array<double, 4>& quaternion);

// The four spheres of the preset `lookdev`.
std::vector<ViewSphere> lookdev_objects();

// INVALID_ARGUMENT naming the field, its value and its limit.
absl::Status check_view(const View& view);

// From a sphere's centre to the camera, in camera axes.
Vector3 centre_to_camera(const ViewCamera& camera, const ViewSphere& sphere);

}  // namespace candela
