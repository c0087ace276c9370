// The last pass on the host: shaders/resolve.comp for a band of rows. Its mathematics are those of
// docs/pipeline.md sections 4 and 5, for the most part the shader's own text.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "server/base/crew.h"
#include "server/render/frame/executor.h"
#include "server/render/frame/frame_textures.h"
#include "server/render/frame/table_points.h"
#include "server/render/plan/plan.h"
#include "shaders/params.h"

namespace candela::host {

// What the pass reads and writes, all of it mapped. Rows of the frame and of the output are
// params.frame.input_pitch and params.output_pitch texels apart.
struct ResolveJob {
  shader::ResolveConstants constants;
  shader::ResolveParams params;
  bool opaque = false;  // every alpha is 1
  const std::byte* wire = nullptr;
  LevelPlanes level{};              // B_0; none without bloom
  const uint32_t* table = nullptr;  // the colour table's points, as table.glsl reads them
  uint32_t table_points = 0;
  const uint32_t* gain = nullptr;  // the gain map's pieces, as gain.glsl reads them
  std::byte* output = nullptr;
};

// What resolve counted in a band of rows of a `wide` frame; see shader::TileRecord.
struct ResolveFound {
  uint64_t gamut_cut_components = 0;
  uint32_t negative_light_bits = 0;
  uint32_t shown_max_bits = 0;
  uint64_t shown_sum = 0;  // in units of 1 / SHOWN_SCALE
};

// Makes rows first <= y < last. Any thread. The bits do not depend on how the rows are split. Needs
// instruction_set().
ResolveFound resolve_rows(const ResolveJob& job, uint32_t first, uint32_t last);

// The last pass, as a plan has it, on a crew of threads.

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
