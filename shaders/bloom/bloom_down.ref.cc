// Twin of bloom_down.comp: 13 taps, each a mean of 2x2 texels.
#include "shaders/reference.h"

namespace candela::reference {

namespace {

// P(i, j): the mean of texels [2x + i, 2x + i + 1] x [2y + j, 2y + j + 1].
Rgb box(const Level& level, int64_t x, int64_t y) {
  Rgb sum{};
  for (int j = 0; j < 2; ++j) {
    for (int i = 0; i < 2; ++i) {
      for (int n = 0; n < 3; ++n) sum[n] += level.at(x + i, y + j)[n] / 4.0;
    }
  }
  return sum;
}

struct Tap {
  int x;
  int y;
  double weight;
};

constexpr Tap kTaps[] = {
    {0, 0, 0.125},   {-2, -2, 0.03125}, {2, -2, 0.03125}, {-2, 2, 0.03125}, {2, 2, 0.03125},
    {-2, 0, 0.0625}, {2, 0, 0.0625},    {0, -2, 0.0625},  {0, 2, 0.0625},   {-1, -1, 0.125},
    {1, -1, 0.125},  {-1, 1, 0.125},    {1, 1, 0.125},
};

}  // namespace

Level bloom_down(const Level& level) {
  Level out{(level.width + 1) / 2, (level.height + 1) / 2, {}};
  out.texels.reserve(size_t{out.width} * out.height);
  for (uint32_t y = 0; y < out.height; ++y) {
    for (uint32_t x = 0; x < out.width; ++x) {
      Rgb& d = out.texels.emplace_back();
      for (const Tap& tap : kTaps) {
        const Rgb p = box(level, 2 * int64_t{x} + tap.x, 2 * int64_t{y} + tap.y);
        for (int n = 0; n < 3; ++n) d[n] += tap.weight * p[n];
      }
    }
    row_done();
  }
  return out;
}

}  // namespace candela::reference
