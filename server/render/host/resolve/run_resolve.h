// The last pass, as a plan has it, on a crew of threads.
#pragma once

#include <cstddef>
#include <vector>

#include "server/base/crew.h"
#include "server/render/frame/executor.h"
#include "server/render/frame/frame_textures.h"
#include "server/render/frame/table_points.h"
#include "server/render/plan/plan.h"

namespace candela::host {

using TablePoints = std::vector<TablePoint>;

// The points of the colour table and the pieces of the gain map; null if there is none.
struct Tables {
  const TablePoints* colors = nullptr;
  const TablePoints* gain = nullptr;
};

// Makes the image, tight at `tight_output`, or in the `output` texture if that is null. Needs
// instruction_set().
Drawn run_resolve(const ResolveStep& step, const Tables& tables, const FrameTextures& textures,
                  std::byte* tight_output, Crew& crew);

// The same, unquantised, into the `exact` texture.
void run_exact(const ResolveStep& step, const Tables& tables, const FrameTextures& textures, Crew& crew);

}  // namespace candela::host
