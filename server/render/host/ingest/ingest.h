// Ingest on the host, from a plan.
#pragma once

#include "server/render/frame/frame_textures.h"
#include "server/render/host/ingest/ingest_tiles.h"
#include "server/render/plan/plan.h"

namespace candela::host {

// Clears the histogram, so make it before the first tile is metered. It points into the textures, which are
// mapped and outlive it. sum_tiles() reads the result.
IngestWork ingest_work(const IngestPlan& plan, const IngestRead& read, const FrameTextures& textures);

}  // namespace candela::host
