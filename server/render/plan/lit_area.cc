#include "server/render/plan/lit_area.h"

#include <algorithm>

#include "shaders/params.h"

namespace candela {
namespace {

// Beyond this number of boxes, or part of the groups, skipping the rest costs more than it saves.
constexpr size_t kMostBoxes = 32;
constexpr double kMostGroups = 0.75;

// Cells of a grid, set or not.
class Mask {
 public:
  Mask(uint32_t width, uint32_t height) : width_(width), height_(height), cells_(size_t{width} * height) {}

  void set(const Box& box) {
    for (uint32_t y = box.y0; y < box.y1; ++y) {
      std::fill_n(cells_.begin() + static_cast<std::ptrdiff_t>(size_t{y} * width_ + box.x0), box.x1 - box.x0,
                  true);
    }
  }
  size_t count() const { return static_cast<size_t>(std::count(cells_.begin(), cells_.end(), true)); }

  // The cells equal to `value`, as disjoint boxes: runs of a row, joined with equal runs of the row before.
  std::vector<Box> boxes(bool value) const {
    std::vector<Box> all;
    std::vector<size_t> above;  // of the row before
    for (uint32_t y = 0; y < height_; ++y) {
      std::vector<size_t> here;
      for (uint32_t x = 0; x < width_;) {
        if (at(x, y) != value) {
          ++x;
          continue;
        }
        const uint32_t begin = x;
        while (x < width_ && at(x, y) == value) ++x;
        const auto same = std::find_if(above.begin(), above.end(),
                                       [&](size_t i) { return all[i].x0 == begin && all[i].x1 == x; });
        if (same == above.end()) {
          here.push_back(all.size());
          all.push_back({begin, y, x, y + 1});
        } else {
          here.push_back(*same);
          ++all[*same].y1;
        }
      }
      above = std::move(here);
    }
    return all;
  }

 private:
  bool at(uint32_t x, uint32_t y) const { return cells_[size_t{y} * width_ + x]; }

  uint32_t width_;
  uint32_t height_;
  std::vector<bool> cells_;
};

// [begin, end), clamped to [0, size).
struct Span {
  uint32_t begin;
  uint32_t end;
};
Span cut(int64_t begin, int64_t end, uint32_t size) {
  return {static_cast<uint32_t>(std::clamp<int64_t>(begin, 0, size)),
          static_cast<uint32_t>(std::clamp<int64_t>(end, 0, size))};
}

// Maps both axes of each box by along(begin, end, size), which clamps to the size.
template <typename Along>
Area each_axis(const Area& area, uint32_t width, uint32_t height, const Along& along) {
  Area mapped;
  mapped.reserve(area.size());
  for (const Box& box : area) {
    const Span x = along(box.x0, box.x1, width);
    const Span y = along(box.y0, box.y1, height);
    mapped.push_back({x.begin, y.begin, x.end, y.end});
  }
  return mapped;
}

}  // namespace

Area lit_area(std::span<const float> tile_light, uint32_t width, uint32_t height, float bound) {
  const uint32_t tiles_x = groups(width, shader::TILE_TEXELS);
  const uint32_t tiles_y = groups(height, shader::TILE_TEXELS);
  Mask lit(tiles_x, tiles_y);
  for (uint32_t y = 0; y < tiles_y; ++y) {
    for (uint32_t x = 0; x < tiles_x; ++x) {
      if (tile_light[size_t{y} * tiles_x + x] > bound) lit.set({x, y, x + 1, y + 1});
    }
  }
  return each_axis(lit.boxes(true), width, height, [](int64_t begin, int64_t end, uint32_t size) {
    return cut(begin * shader::TILE_TEXELS, end * shader::TILE_TEXELS, size);
  });
}

Area in_level(const Area& frame, uint32_t level_size) {
  return each_axis(frame, UINT32_MAX, UINT32_MAX, [level_size](int64_t begin, int64_t end, uint32_t size) {
    return cut(begin / level_size, (end + level_size - 1) / level_size, size);
  });
}

Area in_frame(const Area& level, uint32_t level_size, uint32_t width, uint32_t height) {
  // Bilinear: a texel is seen from its neighbours.
  return each_axis(level, width, height, [level_size](int64_t begin, int64_t end, uint32_t size) {
    return cut((begin - 1) * level_size, (end + 1) * level_size, size);
  });
}

Area after_bloom_down(const Area& from, LevelSize to) {
  // Texel x reads 2x - 2 to 2x + 3.
  return each_axis(from, to.width, to.height, [](int64_t begin, int64_t end, uint32_t size) {
    return cut((begin - 2) >> 1, ((end + 1) >> 1) + 1, size);
  });
}

Area after_bloom_up(const Area& from, LevelSize to) {
  // Texels 2x and 2x + 1 read x - 2 to x + 2.
  return each_axis(from, to.width, to.height, [](int64_t begin, int64_t end, uint32_t size) {
    return cut(2 * (begin - 2), 2 * (end + 2), size);
  });
}

Area after_gaussian(const Area& from, LevelSize size, uint32_t reach_x, uint32_t reach_y) {
  Area grown;
  for (const Box& box : from) {
    const Span x = cut(int64_t{box.x0} - reach_x, int64_t{box.x1} + reach_x, size.width);
    const Span y = cut(int64_t{box.y0} - reach_y, int64_t{box.y1} + reach_y, size.height);
    grown.push_back({x.begin, y.begin, x.end, y.end});
  }
  return grown;
}

Cover cover(const Area& area, uint32_t group_width, uint32_t group_height, uint32_t groups_x,
            uint32_t groups_y) {
  Mask mask(groups_x, groups_y);
  for (const Box& box : area) {
    if (box.x0 >= box.x1 || box.y0 >= box.y1) continue;
    mask.set({box.x0 / group_width, box.y0 / group_height, (box.x1 - 1) / group_width + 1,
              (box.y1 - 1) / group_height + 1});
  }
  Cover cover{mask.boxes(true), mask.boxes(false)};
  const auto all = static_cast<double>(groups_x) * groups_y;
  if (cover.groups.size() > kMostBoxes || static_cast<double>(mask.count()) > kMostGroups * all) {
    cover = {{{0, 0, groups_x, groups_y}}, {}};
  }
  return cover;
}

}  // namespace candela
