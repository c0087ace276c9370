// Views that the host draws. Internal to server/render and its tests.
#pragma once

#include <span>

#include "server/base/crew.h"
#include "server/render/environment/environment.h"
#include "server/render/environment/view.h"
#include "server/render/frame/frame_memory.h"
#include "shaders/environment/environment_params.h"

namespace candela {

// Draws a view into the input of a frame of floats or of halves. `cube` has what the view reads, mapped. The
// bits do not depend on the threads.
void draw_on_host(const BakedCube& cube, bool floats, const View& view, const shader::ViewLight& light,
                  std::span<const shader::ViewObject> objects, FrameMemory& memory, Crew& crew);

}  // namespace candela
