#include "server/session/environment_start.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>

#include "absl/strings/str_format.h"
#include "proto/candela/v1/limits.h"
#include "server/base/status_macros.h"
#include "server/render/settings/settings.h"
#include "server/render/settings/tiers.h"

namespace candela {
namespace {

// Written so that NaN fails.
absl::Status check_range(const char* field, double value, double min, double max) {
  if (value >= min && value <= max) return absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrFormat("%s is %g; it must be between %g and %g", field, value, min, max));
}

absl::StatusOr<Vector3> coordinates(const char* field, const v1::Vector& v, double max) {
  for (const double value : {v.x(), v.y(), v.z()}) {
    RETURN_IF_ERROR(check_range(field, value, -max, max));
  }
  return Vector3{v.x(), v.y(), v.z()};
}

absl::StatusOr<Matrix3> rotation_of(const v1::Camera& camera) {
  if (!camera.has_orientation()) {
    for (const auto& [field, angle] : {std::pair("view.camera.yaw_deg", camera.yaw_deg()),
                                       {"view.camera.pitch_deg", camera.pitch_deg()},
                                       {"view.camera.roll_deg", camera.roll_deg()}}) {
      const auto [min, max] = v1::kCameraAngleDeg;
      RETURN_IF_ERROR(check_range(field, angle, min, max));
    }
    return camera_rotation(camera.yaw_deg(), camera.pitch_deg(), camera.roll_deg());
  }
  if (camera.yaw_deg() != 0 || camera.pitch_deg() != 0 || camera.roll_deg() != 0) {
    return absl::InvalidArgumentError(
        "view.camera has both an orientation and angles; it takes one of the two");
  }
  const v1::Quaternion& q = camera.orientation();
  return camera_rotation({q.x(), q.y(), q.z(), q.w()});
}

absl::Status check_format(const char* field, const char* what, v1::PixelFormat format) {
  constexpr std::array known{v1::PIXEL_FORMAT_RGBA16F, v1::PIXEL_FORMAT_RGBA32F, v1::PIXEL_FORMAT_RGB9E5};
  if (std::ranges::count(known, format) > 0) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrFormat("%s is %d; %s is RGBA16F (1), RGBA32F (2) or RGB9E5 (3)",
                                                    field, static_cast<int>(format), what));
}

BakeQuality quality_of(const Tier& tier) { return {tier.cube_samples, tier.specular_detail}; }

absl::StatusOr<ViewSphere> sphere_from(const v1::Sphere& message) {
  ASSIGN_OR_RETURN(Vector3 centre, coordinates("sphere.centre", message.centre(), v1::kMaxCoordinate));
  ASSIGN_OR_RETURN(Vector3 color, coordinates("sphere.base_color", message.base_color(), 1.0));
  ViewSphere sphere{.centre = centre,
                    .radius = message.radius(),
                    .base_color = color,
                    .metallic = message.metallic(),
                    .roughness = message.roughness(),
                    .fixed_to_camera = message.fixed_to_camera()};
  if (absl::Status status = check_range("sphere.radius", sphere.radius, v1::kLeastRadius, v1::kMaxCoordinate);
      !status.ok()) {
    return status;
  }
  return sphere;
}

}  // namespace

absl::StatusOr<PanoramaStart> panorama_start_from(const v1::EnvironmentStart& start,
                                                  const FrameLimits& limits) {
  RETURN_IF_ERROR(check_format("start.format", "a panorama", start.format()));
  v1::FrameHeader header;
  header.set_width(start.width());
  header.set_height(start.height());
  header.set_format(start.format());
  header.set_row_stride_bytes(start.row_stride_bytes());
  header.set_total_bytes(start.total_bytes());
  ASSIGN_OR_RETURN(const WireLayout layout, wire_layout_from(header, limits));
  if (start.width() > v1::kMaxPanoramaWidth || start.height() > v1::kMaxPanoramaHeight) {
    return absl::ResourceExhaustedError(
        absl::StrFormat("the panorama is %dx%d pixels and the limit is %dx%d; scale it down", start.width(),
                        start.height(), v1::kMaxPanoramaWidth, v1::kMaxPanoramaHeight));
  }
  v1::Settings message;
  if (start.has_input_chromaticities()) {
    *message.mutable_input_chromaticities() = start.input_chromaticities();
  }
  message.set_input_primaries(start.input_primaries());
  message.set_bad_values(start.bad_values());
  ASSIGN_OR_RETURN(const Settings settings, Settings::from(message));
  return PanoramaStart{layout, settings.to_scene(), start.bad_values() == v1::BAD_VALUES_REJECT};
}

absl::StatusOr<View> view_from(const v1::View& message) {
  View view;
  const v1::Camera& camera = message.camera();
  ASSIGN_OR_RETURN(Matrix3 rotation, rotation_of(camera));
  ASSIGN_OR_RETURN(Vector3 position,
                   coordinates("view.camera.position", camera.position(), v1::kMaxCoordinate));
  view.camera = {rotation, position, camera.fov_deg() == 0 ? v1::kDefaultFovDeg : camera.fov_deg()};
  const auto [min, max] = v1::kRotationDeg;
  if (absl::Status status = check_range("view.rotation_deg", message.rotation_deg(), min, max);
      !status.ok()) {
    return status;
  }
  view.rotation_deg = message.rotation_deg();
  view.samples = message.samples() == 0 ? v1::kDefaultViewSamples : message.samples();
  if (static_cast<uint32_t>(message.objects_size()) > v1::kMaxObjects) {
    return absl::InvalidArgumentError(absl::StrFormat("view.objects has %d spheres; the limit is %d",
                                                      message.objects_size(), v1::kMaxObjects));
  }
  for (const v1::Sphere& object : message.objects()) {
    ASSIGN_OR_RETURN(ViewSphere sphere, sphere_from(object));
    view.objects.push_back(sphere);
  }
  RETURN_IF_ERROR(check_view(view));
  return view;
}

BakeQuality view_quality() { return quality_of(*find_tier("standard")); }

absl::StatusOr<BakeStart> bake_start_from(const v1::BakeEnvironmentRequest& request) {
  BakeStart start{.spec = {}, .format = request.format(), .verify = request.verify()};
  RETURN_IF_ERROR(check_format("format", "a bake", start.format));
  const auto [min, max] = v1::kRotationDeg;
  if (absl::Status status = check_range("rotation_deg", request.rotation_deg(), min, max); !status.ok()) {
    return status;
  }
  const uint32_t size = request.size();
  if (size != 0 && (!std::has_single_bit(size) || size < v1::kCubeSize.min || size > v1::kCubeSize.max)) {
    return absl::InvalidArgumentError(
        absl::StrFormat("size is %d; it must be a power of two between %d and %d, or 0 for the default", size,
                        v1::kCubeSize.min, v1::kCubeSize.max));
  }
  const Tier* tier = find_tier(request.tier().empty() ? "standard" : request.tier());
  if (tier == nullptr) {
    return absl::InvalidArgumentError(
        absl::StrFormat("tier is '%s'; GetServerInfo lists the tiers", request.tier()));
  }
  if (!v1::RoughnessMapping_IsValid(request.roughness_mapping())) {
    return absl::InvalidArgumentError(
        absl::StrFormat("roughness_mapping is %d; it must be LINEAR (1) or PERCEPTUAL (2)",
                        static_cast<int>(request.roughness_mapping())));
  }
  start.spec = {.size = size,
                .levels = request.levels(),
                .mapping = request.roughness_mapping() == v1::ROUGHNESS_MAPPING_PERCEPTUAL
                               ? RoughnessMapping::kPerceptual
                               : RoughnessMapping::kLinear,
                .rotation_deg = request.rotation_deg(),
                .quality = quality_of(*tier)};
  return start;
}

}  // namespace candela
