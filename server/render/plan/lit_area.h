// Where in a frame's bloom levels light can be: whatever is outside of it is exactly 0, so that no pass has
// to make it.
//
// An area is a set of boxes, which may overlap, in texels of one level. Each function gives the texels that
// are not 0 for certain after a pass, from those before it; docs/pipeline.md section 4 has the filters.
#pragma once

#include <span>
#include <vector>

#include "server/render/plan/frame_layout.h"
#include "server/vulkan/box.h"

namespace candela {

using Area = std::vector<Box>;

// The frame's texels in tiles whose light is above `bound`. `tile_light`: of every tile, row by row.
Area lit_area(std::span<const float> tile_light, uint32_t width, uint32_t height, float bound);

// In a level of one texel for `level_size` squared of the frame's, from the frame's texels; and back, as
// resolve samples a level.
Area in_level(const Area& frame, uint32_t level_size);
Area in_frame(const Area& level, uint32_t level_size, uint32_t width, uint32_t height);
// D_{n+1} of D_n, and B_n of B_{n+1}; `to` is the size of the level made.
Area after_bloom_down(const Area& from, LevelSize to);
Area after_bloom_up(const Area& from, LevelSize to);
// One pass of kGaussian; `reach` texels along one axis.
Area after_gaussian(const Area& from, LevelSize size, uint32_t reach_x, uint32_t reach_y);

// The work groups that make an area.
struct Cover {
  std::vector<Box> groups;  // disjoint
  std::vector<Box> rest;    // all others
  bool whole() const { return rest.empty(); }
};

// `group_width` x `group_height` texels make a group, of which there are `groups_x` x `groups_y`. Whole where
// the rest would not be worth its dispatches.
Cover cover(const Area& area, uint32_t group_width, uint32_t group_height, uint32_t groups_x,
            uint32_t groups_y);

}  // namespace candela
