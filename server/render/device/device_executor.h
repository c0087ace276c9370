// Renders plans on the Vulkan device.
#pragma once

#include <memory>

#include "server/render/device/passes.h"
#include "server/render/device/submissions.h"
#include "server/render/frame/executor.h"
#include "server/render/frame/tile_sums.h"
#include "server/vulkan/pipeline.h"
#include "server/vulkan/recorder.h"

namespace candela {

class DeviceExecutor final : public Executor {
 public:
  // The device outlives the executor.
  static absl::StatusOr<std::unique_ptr<DeviceExecutor>> create(Device& device);

 private:
  absl::StatusOr<Metered> run_meter(FrameMemory& memory, const IngestPlan& plan) override;
  absl::StatusOr<Drawn> run_draw(FrameMemory& memory, const Plan& plan,
                                 std::vector<StageTime>* stages) override;

  DeviceExecutor(Device& device, PipelineCache pipelines, Recorder recorder);

  // Runs ingest once and adds up its tiles. `upload`: the wire pixels are not on the device yet.
  absl::StatusOr<TileSums> ingest(const FrameTextures& textures, const IngestPlan& plan,
                                  const IngestRead& read, bool upload, std::vector<StageTime>* stages);
  absl::Status record_passes(const FrameTextures& textures, const Plan& plan, const TableBuffers& tables,
                             Submissions& submissions);
  absl::Status record_bloom_step(const BloomStep& step, const FrameTextures& textures,
                                 Submissions& submissions);
  // Makes the resized scene, block by block. The frame's bloom is recorded before.
  absl::Status record_resized(const ResizeStep& step, const FrameTextures& textures,
                              Submissions& submissions);
  // Records the unquantised image, and copies of what verification reads.
  absl::Status record_verification(const FrameTextures& textures, const Plan& plan,
                                   const TableBuffers& tables, Submissions& submissions);

  PipelineCache pipelines_;
  Recorder recorder_;
  Pace pace_;
  TableCache tables_;
};

}  // namespace candela
