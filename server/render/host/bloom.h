// Bloom on the host: its passes on boxes of a level, and as a plan has them, on a crew of threads.
#pragma once

#include <cstddef>

#include "server/base/crew.h"
#include "server/render/frame/frame_textures.h"
#include "server/render/plan/lit_area.h"
#include "server/render/plan/plan.h"
#include "shaders/params.h"

namespace candela::host {

// The passes of the bloom on boxes of a level. Any thread; disjoint boxes at the same time. They need
// instruction_set(). The bits depend neither on the boxes nor on the processor.

// `box` is of the level that is written. Its columns begin at multiples of 32.
struct BrightWork {
  shader::BrightPassConstants constants{};
  shader::BrightPassParams params{};
  const std::byte* wire = nullptr;
};
void bright_pass(const BrightWork& work, const LevelPlanes& to, const Box& box);
void bloom_down(const LevelPlanes& from, const LevelPlanes& to, const Box& box);
// `to` = fine_weight * `to` + the filtered `from`.
void bloom_up(const LevelPlanes& from, const LevelPlanes& to, float fine_weight, const Box& box);
void gaussian(const LevelPlanes& from, const LevelPlanes& to, bool vertical, const Box& box);

// The passes of the bloom, as a plan has them, on a crew of threads.

// A level in its texture.
LevelPlanes level_planes(const FrameTextures& textures, size_t level);

// Makes the level of a step. Needs instruction_set().
void run_bloom(const BloomStep& step, const FrameTextures& textures, Crew& crew);

}  // namespace candela::host
