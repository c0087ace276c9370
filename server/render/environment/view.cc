#include "server/render/environment/view.h"

#include <cmath>
#include <numbers>

#include "absl/strings/str_format.h"
#include "server/base/status_macros.h"
#include "shaders/environment/environment_params.h"

namespace candela {

namespace {

double to_radians(double degrees) { return degrees * std::numbers::pi / 180; }

Matrix3 product(const Matrix3& a, const Matrix3& b) {
  Matrix3 out{};
  for (size_t i = 0; i < 3; ++i) {
    for (size_t j = 0; j < 3; ++j) {
      for (size_t k = 0; k < 3; ++k) out[3 * i + j] += a[3 * i + k] * b[3 * k + j];
    }
  }
  return out;
}

absl::Status out_of_range(const std::string& field, double value, const char* range) {
  return absl::InvalidArgumentError(absl::StrFormat("%s is %g; it must be %s", field, value, range));
}

bool finite(const Vector3& v) { return std::isfinite(v[0]) && std::isfinite(v[1]) && std::isfinite(v[2]); }

absl::Status check_sphere(const ViewCamera& camera, const ViewSphere& sphere, size_t index) {
  const std::string name = absl::StrFormat("view.objects[%d]", index);
  if (!finite(sphere.centre)) return absl::InvalidArgumentError(name + ".centre is not finite");
  if (!(sphere.radius > 0) || !std::isfinite(sphere.radius)) {
    return out_of_range(name + ".radius", sphere.radius, "above 0");
  }
  for (double component : sphere.base_color) {
    if (!(component >= 0 && component <= 1)) return out_of_range(name + ".base_color", component, "0 .. 1");
  }
  if (!(sphere.metallic >= 0 && sphere.metallic <= 1)) {
    return out_of_range(name + ".metallic", sphere.metallic, "0 .. 1");
  }
  if (!(sphere.roughness >= 0 && sphere.roughness <= 1)) {
    return out_of_range(name + ".roughness", sphere.roughness, "0 .. 1");
  }
  const Vector3 o = centre_to_camera(camera, sphere);
  if (std::hypot(o[0], o[1], o[2]) > sphere.radius) return absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrFormat("the camera is in %s, whose centre is %g away and whose radius is %g; move one of them",
                      name, std::hypot(o[0], o[1], o[2]), sphere.radius));
}

}  // namespace

Matrix3 camera_rotation(double yaw_deg, double pitch_deg, double roll_deg) {
  const double y = to_radians(-yaw_deg), x = to_radians(pitch_deg), z = to_radians(-roll_deg);
  const Matrix3 about_y = {std::cos(y), 0, std::sin(y), 0, 1, 0, -std::sin(y), 0, std::cos(y)};
  const Matrix3 about_x = {1, 0, 0, 0, std::cos(x), -std::sin(x), 0, std::sin(x), std::cos(x)};
  const Matrix3 about_z = {std::cos(z), -std::sin(z), 0, std::sin(z), std::cos(z), 0, 0, 0, 1};
  return product(product(about_y, about_x), about_z);
}

absl::StatusOr<Matrix3> camera_rotation(const std::array<double, 4>& quaternion) {
  auto [x, y, z, w] = quaternion;
  const double length = std::sqrt(x * x + y * y + z * z + w * w);
  if (!(std::abs(length - 1) <= 1e-3)) {
    return out_of_range("the length of view.camera.orientation", length, "1 within 0.001");
  }
  x /= length, y /= length, z /= length, w /= length;
  return Matrix3{1 - 2 * (y * y + z * z), 2 * (x * y - z * w),     2 * (x * z + y * w),
                 2 * (x * y + z * w),     1 - 2 * (x * x + z * z), 2 * (y * z - x * w),
                 2 * (x * z - y * w),     2 * (y * z + x * w),     1 - 2 * (x * x + y * y)};
}

std::vector<ViewSphere> lookdev_objects() {
  return {{{-1.8, 0, -4}, 0.5, {1, 1, 1}, 1, 0, true},
          {{-0.6, 0, -4}, 0.5, {0.18, 0.18, 0.18}, 0, 1, true},
          {{0.6, 0, -4}, 0.5, {1, 0.766, 0.336}, 1, 0.3, true},
          {{1.8, 0, -4}, 0.5, {0.8, 0.8, 0.8}, 0, 0.5, true}};
}

absl::Status check_view(const View& view) {
  if (!(view.camera.fov_deg >= 1 && view.camera.fov_deg <= 170)) {
    return out_of_range("view.camera.fov_deg", view.camera.fov_deg, "1 .. 170");
  }
  if (!finite(view.camera.position)) return absl::InvalidArgumentError("view.camera.position is not finite");
  if (!std::isfinite(view.rotation_deg)) return absl::InvalidArgumentError("view.rotation_deg is not finite");
  if (view.samples != 1 && view.samples != 4 && view.samples != 16) {
    return out_of_range("view.samples", view.samples, "1, 4 or 16");
  }
  if (view.objects.size() > shader::VIEW_OBJECTS) {
    return absl::InvalidArgumentError(absl::StrFormat("view.objects has %d spheres; at most %d are possible",
                                                      view.objects.size(), shader::VIEW_OBJECTS));
  }
  for (size_t i = 0; i < view.objects.size(); ++i) {
    RETURN_IF_ERROR(check_sphere(view.camera, view.objects[i], i));
  }
  return absl::OkStatus();
}

Vector3 centre_to_camera(const ViewCamera& camera, const ViewSphere& sphere) {
  if (sphere.fixed_to_camera) return {-sphere.centre[0], -sphere.centre[1], -sphere.centre[2]};
  Vector3 o{};
  for (size_t i = 0; i < 3; ++i) {
    for (size_t k = 0; k < 3; ++k) {
      o[i] += camera.rotation[3 * k + i] * (camera.position[k] - sphere.centre[k]);
    }
  }
  return o;
}

}  // namespace candela
