// Where light reaches: rectangles of texels, tiles and work groups, and the area that bloom has to make.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "server/render/plan/texture_layout.h"

namespace candela {

// Columns x0 to x1 - 1 of rows y0 to y1 - 1.
struct Box {
  uint32_t x0 = 0;
  uint32_t y0 = 0;
  uint32_t x1 = 0;
  uint32_t y1 = 0;
  bool operator==(const Box&) const = default;
};

// The parts of a frame's bloom levels that light can reach. Everything outside them is exactly 0, so no pass
// has to compute it.
//
// An area is a set of boxes in texels of one level; they may overlap. Each function computes the texels that
// may be other than 0 after a pass from those before it. The filters are in docs/pipeline.md section 4.

using Area = std::vector<Box>;

// The texels of the tiles with light above `bound`. `tile_light` has every tile's light, row by row.
Area lit_area(std::span<const float> tile_light, uint32_t width, uint32_t height, float bound);

// Converts an area of the frame into one of a level with one texel for each square of `level_size` frame
// texels, and back, as resolve samples the level.
Area in_level(const Area& frame, uint32_t level_size);
Area in_frame(const Area& level, uint32_t level_size, uint32_t width, uint32_t height);
// The area after the pass from D_n to D_{n+1}, or from B_{n+1} to B_n; `to` is the written level's size.
Area after_bloom_down(const Area& from, LevelSize to);
Area after_bloom_up(const Area& from, LevelSize to);
// The area after one pass of kGaussian, which reaches this many texels along one axis and 0 along the other.
Area after_gaussian(const Area& from, LevelSize size, uint32_t reach_x, uint32_t reach_y);

// The work groups that compute an area.
struct Cover {
  std::vector<Box> groups;  // disjoint
  std::vector<Box> rest;    // all others
  bool whole() const { return rest.empty(); }
};

// A group is `group_width` x `group_height` texels, and there are `groups_x` x `groups_y` groups. The cover
// is whole if leaving out the rest would not be worth the extra dispatches.
Cover cover(const Area& area, uint32_t group_width, uint32_t group_height, uint32_t groups_x,
            uint32_t groups_y);

}  // namespace candela
