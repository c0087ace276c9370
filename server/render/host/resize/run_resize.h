// Resizes the frame's light, as a plan has it, on a crew of threads.
#pragma once

#include "server/base/crew.h"
#include "server/render/frame/frame_textures.h"
#include "server/render/plan/plan.h"

namespace candela::host {

// Makes the `scene` texture. Needs instruction_set().
void run_resize(const ResizeStep& step, const FrameTextures& textures, Crew& crew);

}  // namespace candela::host
