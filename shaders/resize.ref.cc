// Twin of resize.comp: an image of another size, from the frame's light. First along y, then along x.
#include <algorithm>
#include <cmath>
#include <deque>
#include <limits>
#include <numbers>
#include <vector>

#include "shaders/reference.h"

namespace candela::reference {

namespace {

using Row = std::vector<Light>;

double sinc(double t) {
  const double x = std::numbers::pi * t;
  return t == 0 ? 1 : std::sin(x) / x;
}

// A texel that an output is made of.
struct Tap {
  uint32_t texel;
  double weight;
  bool main_lobe;
};

// The texels of output i where `from` texels become `to`.
std::vector<Tap> taps_of(uint32_t from, uint32_t to, uint32_t i) {
  std::vector<Tap> taps;
  if (from % to == 0) {
    const uint32_t count = from / to;
    for (uint32_t k = 0; k < count; ++k) taps.push_back({i * count + k, 1.0 / count, true});
    return taps;
  }
  const double stretch = std::max(1.0, 1.0 * from / to);
  const double centre = (i + 0.5) * from / to;
  const auto first = static_cast<int64_t>(std::floor(centre - 3 * stretch)) - 1;
  const auto last = static_cast<int64_t>(std::ceil(centre + 3 * stretch)) + 1;
  double sum = 0;
  for (int64_t k = std::max<int64_t>(0, first); k < std::min<int64_t>(last, from); ++k) {
    const double t = (k + 0.5 - centre) / stretch;
    // Whether a texel lies under the main lobe is decided in integers: at its edge the weight is 0, but the
    // texel counts.
    const int64_t distance = (2 * k + 1) * to - int64_t{2 * i + 1} * from;
    if (std::abs(t) >= 3) continue;
    const double weight = sinc(t) * sinc(t / 3);
    taps.push_back({static_cast<uint32_t>(k), weight, std::abs(distance) < 2 * int64_t{std::max(from, to)}});
    sum += weight;
  }
  for (Tap& tap : taps) tap.weight /= sum;
  return taps;
}

// The weighted sum of `at(texel)`, between the smallest and the largest texel under the main lobe.
template <typename At>
Light filtered(const std::vector<Tap>& taps, const At& at) {
  Light sum{};
  Light low;
  Light high;
  low.fill(std::numeric_limits<double>::infinity());
  high.fill(-std::numeric_limits<double>::infinity());
  for (const Tap& tap : taps) {
    const Light& light = at(tap.texel);
    for (size_t n = 0; n < 4; ++n) {
      sum[n] += tap.weight * light[n];
      if (!tap.main_lobe) continue;
      low[n] = std::min(low[n], light[n]);
      high[n] = std::max(high[n], light[n]);
    }
  }
  for (size_t n = 0; n < 4; ++n) sum[n] = std::clamp(sum[n], low[n], high[n]);
  return sum;
}

}  // namespace

Scene resize(const Scene& scene, const Level& bloom, uint32_t level_count, const ResolveParams& params,
             uint32_t width, uint32_t height) {
  std::vector<std::vector<Tap>> across;
  for (uint32_t x = 0; x < width; ++x) across.push_back(taps_of(scene.width, width, x));
  Scene image;
  image.width = width;
  image.height = height;
  image.texels.reserve(size_t{width} * height);
  std::deque<Row> rows;  // of the frame, from `first` on
  uint32_t first = 0;
  Row narrow(scene.width);
  for (uint32_t y = 0; y < height; ++y) {
    const std::vector<Tap> down = taps_of(scene.height, height, y);
    for (; first < down.front().texel && !rows.empty(); ++first) rows.pop_front();
    if (rows.empty()) first = down.front().texel;
    while (first + rows.size() <= down.back().texel) {
      const auto from = static_cast<uint32_t>(first + rows.size());
      Row& row = rows.emplace_back();
      row.reserve(scene.width);
      for (uint32_t x = 0; x < scene.width; ++x) {
        row.push_back(light_at(scene, bloom, level_count, params, x, from));
      }
      row_done();
    }
    for (uint32_t x = 0; x < scene.width; ++x) {
      narrow[x] = filtered(down, [&](uint32_t texel) -> const Light& { return rows[texel - first][x]; });
    }
    for (uint32_t x = 0; x < width; ++x) {
      const Light light = filtered(across[x], [&](uint32_t texel) -> const Light& { return narrow[texel]; });
      image.texels.push_back({static_cast<float>(light[0]), static_cast<float>(light[1]),
                              static_cast<float>(light[2]), static_cast<float>(light[3])});
    }
    row_done();
  }
  return image;
}

}  // namespace candela::reference
