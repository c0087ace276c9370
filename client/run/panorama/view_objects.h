// The spheres of `candela view --objects`.
#pragma once

#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "candela/v1/render.pb.h"

namespace candela {

// The word for the preset.
inline constexpr char kLookdev[] = "lookdev";

// The preset `lookdev` of docs/environments.md section 6, or the spheres of a file of the form
// {"objects": [{"centre": [x, y, z], "radius": r, "base_color": [r, g, b], "metallic": m, "roughness": r,
// "fixed_to_camera": true}]}; only centre and radius must be there. "" is no sphere. Errors begin with the
// path: those of read_json(), and INVALID_ARGUMENT that names the member that is wrong.
absl::StatusOr<std::vector<v1::Sphere>> view_objects(const std::string& choice);

}  // namespace candela
