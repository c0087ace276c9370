// Phase A, whoever executes it: the frame's statistics, added up from what ingest wrote for each tile.
#pragma once

#include <cstdint>
#include <vector>

#include "absl/functional/function_ref.h"
#include "absl/status/statusor.h"
#include "server/render/frame/executor.h"
#include "server/render/frame/frame_textures.h"
#include "server/render/plan/plan.h"

namespace candela {

struct TileSums {
  FrameStats stats;
  // A component on the wire or in the scene is not finite or beyond +-MAX_HALF. The first read may say so
  // falsely if an alpha is not 1.
  bool needs_scrub = false;
  bool alpha_differs = false;             // an alpha is not 1; only with METER_OPAQUE
  bool uncovered = false;                 // no alpha is above 0, and something is there; with METER_COVERAGE
  uint32_t first_bad_texel = UINT32_MAX;  // y * width + x; UINT32_MAX: none
};

// Reads the tiles and the histogram in the textures' host buffers. `plan` and `read` are those that ingest
// ran with.
TileSums sum_tiles(const FrameTextures& textures, const IngestPlan& plan, const IngestRead& read);

// What resolve found in a plan with `wide` set.
Drawn drawn_from_tiles(const FrameTextures& textures);

// Reads the frame once and adds its time to *stages. `again`: it was read before.
using ReadFrame = absl::FunctionRef<absl::StatusOr<TileSums>(const IngestRead& read, bool again,
                                                             std::vector<StageTime>* stages)>;

// Reads the frame until nothing on the wire asks for another way to read
// it. Fails as `read_frame` does, or with INVALID_ARGUMENT naming the pixel if the plan rejects bad values
// and there is one.
absl::StatusOr<Metered> meter_frame(const IngestPlan& plan, const FrameDesc& desc, ReadFrame read_frame);

}  // namespace candela
