// The compute passes of a frame on the device, and a cache of the colour tables that they read. Internal to
// server/render.
#pragma once

#include <cstdint>
#include <memory>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "server/render/frame/frame_textures.h"
#include "server/render/frame/table_points.h"
#include "server/render/plan/plan.h"
#include "server/vulkan/buffer.h"
#include "server/vulkan/pipeline.h"
#include "server/vulkan/recorder.h"

namespace candela {

// One thread at a time. The device outlives it.
class TableCache {
 public:
  explicit TableCache(Device& device) : device_(device) {}

  // The device's copy of an equal table. If the table is new and the device's
  // memory is not mapped, this uploads it in a separate submission. RESOURCE_EXHAUSTED if the device has no
  // memory for it; otherwise fails as Recorder::submit_and_wait does.
  absl::StatusOr<std::shared_ptr<const Buffer>> get(const std::shared_ptr<const ColorTable>& table,
                                                    Recorder& recorder);

 private:
  Device& device_;
  TablesUsedLast<Buffer> tables_;
};

// Records the passes of a frame: the pipeline, its parameters and its work groups, as a plan has them; all
// rows of work groups, or some. Internal to server/render. Barriers between passes are the caller's.

// Rows `first` to `last` - 1 of work groups.
struct GroupRows {
  uint32_t first = 0;
  uint32_t last = UINT32_MAX;
};

// The work groups of ingest, and the texels that each meters.
Box ingest_groups(const TextureLayout& layout);
inline constexpr double kIngestGroupTexels =
    double{shader::INGEST_TILES} * shader::TILE_TEXELS * shader::TILE_TEXELS;
// The texels that a work group of resolve makes.
inline constexpr double kResolveGroupTexels =
    double{shader::RESOLVE_GROUP_X} * shader::GROUP_TEXELS * kResolveGroupRows;

absl::Status record_ingest(const IngestPlan& plan, const IngestRead& read, const FrameTextures& textures,
                           PipelineCache& pipelines, Recorder& recorder, const GroupRows& rows = {});

// If the step asks for clear_first, its level has been cleared.
absl::Status record_bloom(const BloomStep& step, const FrameTextures& textures, PipelineCache& pipelines,
                          Recorder& recorder, const GroupRows& rows = {});

// The colour table's points and the gain map's pieces on the device; null if there is none.
struct TableBuffers {
  const Buffer* colors = nullptr;
  const Buffer* gain = nullptr;
};

absl::Status record_resolve(const ResolveStep& step, const TableBuffers& tables,
                            const FrameTextures& textures, PipelineCache& pipelines, Recorder& recorder,
                            const GroupRows& rows = {});

// Along y from the frame to the block of rows that begins at row `block` of the image, or along x from the
// block to the scene. The weights are on the device.
absl::Status record_resize(const ResizeStep& step, bool down, uint32_t block, const FrameTextures& textures,
                           PipelineCache& pipelines, Recorder& recorder, const GroupRows& rows = {});
// The work groups of either, and the texels that each reads.
Box resize_groups(const ResizeStep& step, bool down, uint32_t block, const TextureLayout& layout);
double resize_group_texels(const ResizeStep& step, bool down);

// Records resolve once more, unquantised, into the `exact` texture.
absl::Status record_exact(const ResolveStep& step, const TableBuffers& tables, const FrameTextures& textures,
                          PipelineCache& pipelines, Recorder& recorder, const GroupRows& rows = {});

}  // namespace candela
