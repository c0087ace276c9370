// A view in the form that view.comp reads. Internal to server/render. Pure.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "server/render/environment/cube_levels.h"
#include "server/render/environment/harmonics.h"
#include "server/render/environment/view.h"
#include "shaders/environment/environment_params.h"

namespace candela {

// Without objects and first_row.
shader::ViewParams view_params(const View& view, uint32_t width, uint32_t height, uint32_t pitch,
                               uint32_t chain_size);

// `specular` has the levels after level 0, with the perceptual mapping; it may be empty. `brdf` is the BRDF
// table: halves, row by row.
std::vector<shader::ViewObject> view_objects(const View& view, const CubeLevels& specular,
                                             std::span<const uint16_t> brdf);
shader::ViewLight view_light(const Harmonics& irradiance);
// What the shader reads as the scene.
std::vector<std::byte> view_scene(const shader::ViewLight& light,
                                  std::span<const shader::ViewObject> objects);

}  // namespace candela
