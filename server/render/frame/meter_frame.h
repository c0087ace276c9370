// Phase A, whoever executes its reads. Internal to server/render.
#pragma once

#include <vector>

#include "absl/functional/function_ref.h"
#include "absl/status/statusor.h"
#include "server/render/frame/tile_sums.h"
#include "server/render/plan/plan.h"

namespace candela {

// Reads the frame once and adds its time to *stages. `again`: it was read before.
using ReadFrame = absl::FunctionRef<absl::StatusOr<TileSums>(const IngestRead& read, bool again,
                                                             std::vector<StageTime>* stages)>;

// Reads the frame until nothing on the wire asks for another way to read it. Fails as `read_frame` does, or
// with INVALID_ARGUMENT naming the pixel if the plan rejects bad values and there is one.
absl::StatusOr<Metered> meter_frame(const IngestPlan& plan, const FrameDesc& desc, ReadFrame read_frame);

}  // namespace candela
