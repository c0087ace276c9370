// A view in the form that view.comp reads, and where its objects can be seen. Internal to server/render.
// Pure.
#pragma once

#include <cstdint>
#include <vector>

#include "server/render/environment/cube_levels.h"
#include "server/render/environment/harmonics.h"
#include "server/render/environment/view.h"
#include "server/vulkan/box.h"
#include "shaders/params.h"

namespace candela {

// Without addresses and first_row.
shader::ViewParams view_params(const View& view, uint32_t width, uint32_t height, uint32_t pitch,
                               uint32_t chain_size);

// Whether the sky is read from level 0 alone, wherever the camera looks.
bool is_magnified(const shader::ViewParams& params);

// `specular` has the levels after level 0, with the perceptual mapping; it may be empty.
shader::ViewScene view_scene(const View& view, const Harmonics& irradiance, const CubeLevels& specular);

// A row of tiles as runs of work groups: those that a sphere may touch, and the others.
struct TileRow {
  std::vector<Box> with_objects;
  std::vector<Box> sky;
  uint32_t object_tiles = 0;
  uint32_t sky_tiles = 0;
};
std::vector<TileRow> tile_rows(const View& view, uint32_t width, uint32_t height, uint32_t pitch);

}  // namespace candela
