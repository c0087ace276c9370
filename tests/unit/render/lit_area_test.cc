// The area that light can reach in each pass of the bloom, against a count of every texel that a pass reads.
#include "server/render/plan/lit_area.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <utility>

namespace candela {
namespace {

// The texels that are not 0.
struct Grid {
  LevelSize size;
  std::vector<bool> lit;

  explicit Grid(LevelSize of) : size(of), lit(size_t{of.width} * of.height) {}
  // Clamped to the edge, as the passes read.
  bool at(int64_t x, int64_t y) const {
    const auto clamped = [](int64_t v, uint32_t n) {
      return static_cast<size_t>(std::clamp<int64_t>(v, 0, n - 1));
    };
    return lit[clamped(y, size.height) * size.width + clamped(x, size.width)];
  }
  bool any(int64_t x0, int64_t y0, int64_t x1, int64_t y1) const {
    for (int64_t y = y0; y <= y1; ++y) {
      for (int64_t x = x0; x <= x1; ++x) {
        if (at(x, y)) return true;
      }
    }
    return false;
  }
  void set(uint32_t x, uint32_t y) { lit[size_t{y} * size.width + x] = true; }
};

Grid grid_of(const Area& area, LevelSize size) {
  Grid grid(size);
  for (const Box& box : area) {
    for (uint32_t y = box.y0; y < box.y1; ++y) {
      for (uint32_t x = box.x0; x < box.x1; ++x) grid.set(x, y);
    }
  }
  return grid;
}

// `reads(x, y)` says whether a texel of the new level reads a lit one.
template <typename Reads>
Grid next(LevelSize size, const Reads& reads) {
  Grid grid(size);
  for (uint32_t y = 0; y < size.height; ++y) {
    for (uint32_t x = 0; x < size.width; ++x) {
      if (reads(int64_t{x}, int64_t{y})) grid.set(x, y);
    }
  }
  return grid;
}

// Whether all of `lit` is in `area`.
void expect_holds(const Area& area, const Grid& lit, const std::string& what) {
  const Grid held = grid_of(area, lit.size);
  for (size_t i = 0; i < lit.lit.size(); ++i) {
    ASSERT_TRUE(!lit.lit[i] || held.lit[i])
        << what << ": texel " << i % lit.size.width << ", " << i / lit.size.width;
  }
}

size_t count(const std::vector<bool>& cells) {
  return static_cast<size_t>(std::count(cells.begin(), cells.end(), true));
}

constexpr std::pair<uint32_t, uint32_t> kSizes[] = {{1, 1}, {63, 65}, {200, 130}, {257, 511}, {640, 360}};

TEST(LitArea, HoldsEveryTexelThatAPassMakesOfLight) {
  std::mt19937 random(7);
  for (const auto& [width, height] : kSizes) {
    const uint32_t tiles_x = (width + 63) / 64, tiles_y = (height + 63) / 64;
    for (const uint32_t level_size : {2u, 4u}) {
      for (int round = 0; round < 4; ++round) {
        const std::string what = std::to_string(width) + "x" + std::to_string(height) + ", round " +
                                 std::to_string(round) + ", level size " + std::to_string(level_size);
        std::vector<float> light(size_t{tiles_x} * tiles_y, 0.5f);
        light[random() % light.size()] = 2.0f;
        if (round > 1) light[random() % light.size()] = 2.0f;
        Area area = lit_area(light, width, height, 1.0f);
        Grid frame(LevelSize{width, height});
        for (uint32_t y = 0; y < height; ++y) {
          for (uint32_t x = 0; x < width; ++x) {
            if (light[size_t{y / 64} * tiles_x + x / 64] > 1.0f) frame.set(x, y);
          }
        }
        ASSERT_EQ(grid_of(area, frame.size).lit, frame.lit) << what;

        const std::vector<LevelSize> sizes = bloom_level_sizes(width, height, 6, level_size);
        const int64_t n = level_size;
        Grid level = next(sizes[0], [&](int64_t x, int64_t y) {
          return frame.any(n * x, n * y, n * x + n - 1, n * y + n - 1);
        });
        area = in_level(area, level_size);
        expect_holds(area, level, what + ", level 0");
        // B_n also reads D_n, which lies within the reach of B_{n+1} and is checked with it.
        std::vector<Grid> down = {level};
        for (size_t i = 1; i < sizes.size(); ++i) {
          const Grid& from = down.back();
          down.push_back(next(sizes[i], [&](int64_t x, int64_t y) {
            return from.any(2 * x - 2, 2 * y - 2, 2 * x + 3, 2 * y + 3);
          }));
          area = after_bloom_down(area, sizes[i]);
          expect_holds(area, down.back(), what + ", down to " + std::to_string(i));
        }
        level = down.back();
        for (size_t i = sizes.size() - 1; i-- > 0;) {
          // Even texels read from x / 2 - 2 to x / 2 + 1, odd ones one texel further.
          const auto first = [](int64_t x) { return x / 2 - 2 + x % 2; };
          level = next(sizes[i], [&](int64_t x, int64_t y) {
            return down[i].at(x, y) || level.any(first(x), first(y), first(x) + 3, first(y) + 3);
          });
          area = after_bloom_up(area, sizes[i]);
          expect_holds(area, level, what + ", up to " + std::to_string(i));
          // An even and an odd texel count as one, at each of five levels.
          if (i == 0) {
            EXPECT_LE(count(grid_of(area, level.size).lit), count(level.lit) * 2 + 64) << what;
          }
        }
        const Grid seen = next({width, height}, [&](int64_t x, int64_t y) {
          const int64_t at = (2 * x + 1 - n) >> 1;  // in frame texels, from the first level texel's centre
          const int64_t row = (2 * y + 1 - n) >> 1;
          const auto below = [n](int64_t v) { return v >= 0 ? v / n : -1; };
          return level.any(below(at), below(row), below(at) + 1, below(row) + 1);
        });
        expect_holds(in_frame(area, level_size, width, height), seen, what + ", in the frame");
      }
    }
  }
}

TEST(LitArea, IsSeenInTheFrameATexelOfTheLevelAround) {
  EXPECT_EQ(in_level({{33, 64, 65, 128}}, 4), (Area{{8, 16, 17, 32}}));
  EXPECT_EQ(in_frame({{10, 0, 14, 24}}, 2, 100, 49), (Area{{18, 0, 30, 49}}));
  EXPECT_EQ(in_frame({{10, 0, 14, 24}}, 4, 57, 200), (Area{{36, 0, 57, 100}}));
}

TEST(LitArea, OfTheGaussianGrowsBySixTexelsEachWay) {
  const Area lit = {{10, 20, 14, 24}};
  EXPECT_EQ(after_gaussian(lit, {100, 100}, 0, 6), (Area{{10, 14, 14, 30}}));
  EXPECT_EQ(after_gaussian(lit, {16, 22}, 6, 0), (Area{{4, 20, 16, 22}}));
}

TEST(LitArea, IsCoveredByWholeGroupsAndTheRestIsTheOthers) {
  std::mt19937 random(3);
  for (int round = 0; round < 200; ++round) {
    const LevelSize size = {100 + static_cast<uint32_t>(random() % 400),
                            50 + static_cast<uint32_t>(random() % 200)};
    Area area;
    for (int i = 0; i < round % 6; ++i) {
      const auto x = static_cast<uint32_t>(random() % size.width),
                 y = static_cast<uint32_t>(random() % size.height);
      area.push_back(
          {x, y, std::min<uint32_t>(size.width, x + random() % 90), std::min<uint32_t>(size.height, y + 9)});
    }
    const uint32_t groups_x = (size.width + 15) / 16, groups_y = (size.height + 7) / 8;
    const Cover work = cover(area, 16, 8, groups_x, groups_y);
    std::vector<int> times(size_t{groups_x} * groups_y);
    for (const std::vector<Box>* part : {&work.groups, &work.rest}) {
      for (const Box& box : *part) {
        for (uint32_t y = box.y0; y < box.y1; ++y) {
          for (uint32_t x = box.x0; x < box.x1; ++x) ++times.at(size_t{y} * groups_x + x);
        }
      }
    }
    EXPECT_EQ(times, std::vector<int>(times.size(), 1)) << "each group is in one box";
    const Grid held = grid_of(work.groups, {groups_x, groups_y});
    const Grid lit = grid_of(area, size);
    for (uint32_t y = 0; y < size.height; ++y) {
      for (uint32_t x = 0; x < size.width; ++x) ASSERT_TRUE(!lit.at(x, y) || held.at(x / 16, y / 8));
    }
  }
}

TEST(LitArea, ThatIsNearlyAllOrInManyPiecesIsTakenWhole) {
  const std::vector<Box> all = {{0, 0, 20, 20}};
  EXPECT_EQ(cover({{0, 0, 20, 16}}, 1, 1, 20, 20).groups, all);
  EXPECT_TRUE(cover({{0, 0, 20, 16}}, 1, 1, 20, 20).whole());
  EXPECT_FALSE(cover({{0, 0, 20, 15}}, 1, 1, 20, 20).whole());
  Area pieces;
  for (uint32_t i = 0; i < 40; ++i)
    pieces.push_back({2 * (i % 10), 2 * (i / 10), 2 * (i % 10) + 1, 2 * (i / 10) + 1});
  EXPECT_EQ(cover(pieces, 1, 1, 20, 20).groups, all);
  EXPECT_TRUE(cover({}, 1, 1, 20, 20).groups.empty());
  EXPECT_EQ(cover({}, 1, 1, 20, 20).rest, all);
}

}  // namespace
}  // namespace candela
