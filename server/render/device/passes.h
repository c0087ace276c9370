// Records the passes of a frame: the pipeline, its parameters and its work groups, as a plan has them.
// Internal to server/render. Barriers between passes are the caller's.
#pragma once

#include "absl/status/status.h"
#include "server/render/device/frame_textures.h"
#include "server/render/plan/plan.h"
#include "server/vulkan/pipeline.h"
#include "server/vulkan/recorder.h"

namespace candela {

absl::Status record_ingest(const IngestPlan& plan, const IngestRead& read, const FrameTextures& textures,
                           PipelineCache& pipelines, Recorder& recorder);

absl::Status record_bloom(const BloomStep& step, const FrameTextures& textures, PipelineCache& pipelines,
                          Recorder& recorder);

// `table`: the colour table's points on the device; null if the curve has none.
absl::Status record_resolve(const ResolveStep& step, const Buffer* table, const FrameTextures& textures,
                            PipelineCache& pipelines, Recorder& recorder);

// Records resolve once more, unquantised, into the `exact` texture.
absl::Status record_exact(const ResolveStep& step, const Buffer* table, const FrameTextures& textures,
                          PipelineCache& pipelines, Recorder& recorder);

}  // namespace candela
