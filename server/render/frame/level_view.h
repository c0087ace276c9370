// The light of a bloom level, whoever made it. For verification and tests.
#pragma once

#include <array>
#include <cstdint>
#include <cstring>

#include "server/render/frame/frame_textures.h"
#include "server/render/frame/level_planes.h"

namespace candela {

class LevelView {
 public:
  // `texels` holds the level, mapped.
  LevelView(const FrameTextures& textures, const LevelSize& size, const Buffer& texels)
      : planar_(textures.planar_levels), size_(size), texels_(reinterpret_cast<float*>(texels.mapped())) {}

  const LevelSize& size() const { return size_; }

  std::array<float, 3> at(size_t x, size_t y) const {
    if (!planar_) {
      const float* const texel = texels_ + 4 * (y * size_.width + x);
      return {texel[0], texel[1], texel[2]};
    }
    const host::LevelPlanes planes = {texels_, size_.width, size_.height};
    return {planes.row(y, 0)[x], planes.row(y, 1)[x], planes.row(y, 2)[x]};
  }

 private:
  bool planar_;
  LevelSize size_;
  float* texels_;
};

}  // namespace candela
