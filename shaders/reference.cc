#include "shaders/reference.h"

#include <algorithm>

namespace candela::reference {

namespace {

size_t clamped_index(int64_t x, int64_t y, uint32_t width, uint32_t height) {
  const int64_t cx = std::clamp<int64_t>(x, 0, int64_t{width} - 1);
  const int64_t cy = std::clamp<int64_t>(y, 0, int64_t{height} - 1);
  return static_cast<size_t>(cy) * width + static_cast<size_t>(cx);
}

}  // namespace

const std::array<float, 4>& Scene::at(int64_t x, int64_t y) const {
  return texels[clamped_index(x, y, width, height)];
}

const Rgb& Level::at(int64_t x, int64_t y) const { return texels[clamped_index(x, y, width, height)]; }

}  // namespace candela::reference
