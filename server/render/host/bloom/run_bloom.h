// The passes of the bloom, as a plan has them, on a crew of threads.
#pragma once

#include "server/base/crew.h"
#include "server/render/frame/frame_textures.h"
#include "server/render/plan/plan.h"

namespace candela::host {

// A level in its texture.
LevelPlanes level_planes(const FrameTextures& textures, size_t level);

// Makes the level of a step. Needs instruction_set().
void run_bloom(const BloomStep& step, const FrameTextures& textures, Crew& crew);

}  // namespace candela::host
