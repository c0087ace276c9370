#include "client/run/panorama/view_objects.h"

#include <array>

#include "absl/strings/str_format.h"
#include "client/base/failure.h"
#include "client/run/panorama/json_fields.h"

namespace candela {
namespace {

using Triple = std::array<double, 3>;

constexpr v1::Range<double> kCoordinate{-v1::kMaxCoordinate, v1::kMaxCoordinate};
constexpr v1::Range<double> kRadius{v1::kLeastRadius, v1::kMaxCoordinate};
constexpr v1::Range<double> kUnit{0, 1};
constexpr Triple kGrey{0.8, 0.8, 0.8};

void set_vector(v1::Vector& vector, const Triple& xyz) {
  vector.set_x(xyz[0]);
  vector.set_y(xyz[1]);
  vector.set_z(xyz[2]);
}

struct LookdevSphere {
  double x;
  Triple base_color;
  double metallic, roughness;
};
constexpr LookdevSphere kLookdevSpheres[] = {
    {-1.8, {1, 1, 1}, 1, 0},           // chrome
    {-0.6, {0.18, 0.18, 0.18}, 0, 1},  // grey
    {0.6, {1, 0.766, 0.336}, 1, 0.3},  // gold
    {1.8, {0.8, 0.8, 0.8}, 0, 0.5},    // plastic
};

std::vector<v1::Sphere> lookdev() {
  std::vector<v1::Sphere> spheres;
  for (const LookdevSphere& look : kLookdevSpheres) {
    v1::Sphere& sphere = spheres.emplace_back();
    set_vector(*sphere.mutable_centre(), {look.x, 0, -4});
    sphere.set_radius(0.5);
    set_vector(*sphere.mutable_base_color(), look.base_color);
    sphere.set_metallic(look.metallic);
    sphere.set_roughness(look.roughness);
    sphere.set_fixed_to_camera(true);
  }
  return spheres;
}

v1::Sphere sphere_from(const nlohmann::json& object, const std::string& name, absl::Status& status) {
  JsonFields fields(object, name, status);
  fields.allow({"centre", "radius", "base_color", "metallic", "roughness", "fixed_to_camera"});
  v1::Sphere sphere;
  set_vector(*sphere.mutable_centre(), fields.triple("centre", kCoordinate, std::nullopt));
  sphere.set_radius(fields.number("radius", kRadius, std::nullopt));
  set_vector(*sphere.mutable_base_color(), fields.triple("base_color", kUnit, kGrey));
  sphere.set_metallic(fields.number("metallic", kUnit, 0));
  sphere.set_roughness(fields.number("roughness", kUnit, 0.5));
  sphere.set_fixed_to_camera(fields.flag("fixed_to_camera", false));
  return sphere;
}

}  // namespace

absl::StatusOr<std::vector<v1::Sphere>> view_objects(const std::string& choice) {
  if (choice.empty()) return std::vector<v1::Sphere>();
  if (choice == kLookdev) return lookdev();
  const absl::StatusOr<nlohmann::json> json = read_json(choice, "objects");
  if (!json.ok()) return json.status();
  absl::Status status;
  JsonFields file(*json, "", status);
  file.allow({"objects"});
  std::vector<v1::Sphere> spheres;
  for (const nlohmann::json& object : file.array("objects", 0, v1::kMaxObjects)) {
    spheres.push_back(sphere_from(object, absl::StrFormat("objects[%d].", spheres.size()), status));
  }
  if (status.ok()) return spheres;
  return input_failure(reworded(status, absl::StrFormat("%s: %s", choice, status.message())), choice);
}

}  // namespace candela
