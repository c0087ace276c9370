#include "server/render/device/device_executor.h"

#include <utility>

#include "server/render/device/meter_frame.h"
#include "server/render/device/passes.h"
#include "server/render/plan/metering.h"

namespace candela {

namespace {

// Each takes 2 to 3 MB on the software device; clients choose the settings that they are made for.
constexpr size_t kMaxPipelines = 64;

void add_timings(const Recorder& recorder, std::vector<StageTime>* stages) {
  for (const Recorder::Timing& timing : recorder.timings()) add_time({timing.name, timing.ns}, stages);
}

// Nothing on a device with unified memory, which has no copy to read.
void read_back(const TexturePool::Lease& from, const TexturePool::Lease& to, Recorder& recorder) {
  if (to) recorder.copy(from.buffer(), to.buffer(), to.buffer().bytes());
}

}  // namespace

DeviceExecutor::DeviceExecutor(Device& device, PipelineCache pipelines, Recorder recorder)
    : pipelines_(std::move(pipelines)), recorder_(std::move(recorder)), tables_(device) {}

absl::StatusOr<std::unique_ptr<DeviceExecutor>> DeviceExecutor::create(Device& device) {
  absl::StatusOr<PipelineCache> pipelines = PipelineCache::create(device);
  if (!pipelines.ok()) return pipelines.status();
  absl::StatusOr<Recorder> recorder = Recorder::create(device);
  if (!recorder.ok()) return recorder.status();
  return std::unique_ptr<DeviceExecutor>(
      new DeviceExecutor(device, *std::move(pipelines), *std::move(recorder)));
}

absl::StatusOr<Metered> DeviceExecutor::meter(FrameMemory& memory, const IngestPlan& plan) {
  if (absl::Status status = recorder_.usable(); !status.ok()) return status;
  const FrameTextures& textures = memory.textures();
  pipelines_.trim(kMaxPipelines);
  return meter_frame(plan, textures.layout.desc,
                     [&](const IngestRead& read, bool again, std::vector<StageTime>* stages) {
                       return ingest(textures, plan, read, /*upload=*/!again, stages);
                     });
}

absl::StatusOr<TileSums> DeviceExecutor::ingest(const FrameTextures& textures, const IngestPlan& plan,
                                                const IngestRead& read, bool upload,
                                                std::vector<StageTime>* stages) {
  if (absl::Status status = recorder_.begin(); !status.ok()) return status;
  if (upload && textures.upload) {
    recorder_.mark("upload");
    recorder_.copy(textures.upload.buffer(), textures.input.buffer(), textures.input.buffer().bytes());
  }
  recorder_.mark(name(Pass::kIngest));
  recorder_.fill_zero(textures.tiles.buffer());
  if (textures.histogram) {
    recorder_.fill_zero(textures.histogram.buffer(), textures.layout.histogram_bytes(read.scrub));
  }
  if (textures.center_weights) {
    const std::vector<uint32_t> weights = center_weights();
    recorder_.update(textures.center_weights.buffer(), weights.data(), weights.size() * sizeof weights[0]);
  }
  recorder_.barrier();
  if (absl::Status status = record_ingest(plan, read, textures, pipelines_, recorder_); !status.ok()) {
    return status;
  }
  if (textures.tiles_readback) {
    recorder_.barrier();
    read_back(textures.tiles, textures.tiles_readback, recorder_);
    read_back(textures.histogram, textures.histogram_readback, recorder_);
  }
  recorder_.barrier_to_host();
  if (absl::Status status = recorder_.submit_and_wait(); !status.ok()) return status;
  add_timings(recorder_, stages);
  return sum_tiles(textures, plan, read);
}

absl::StatusOr<Drawn> DeviceExecutor::draw(FrameMemory& memory, const Plan& plan,
                                           std::vector<StageTime>* stages) {
  if (absl::Status status = recorder_.usable(); !status.ok()) return status;
  const FrameTextures& textures = memory.textures();
  pipelines_.trim(kMaxPipelines);
  const Buffer* table = nullptr;
  if (plan.table) {
    absl::StatusOr<const Buffer*> points = tables_.get(plan.table, recorder_);
    if (!points.ok()) return points.status();
    table = *points;
  }
  if (absl::Status status = recorder_.begin(); !status.ok()) return status;
  absl::Status status = record_passes(textures, plan, table);
  if (status.ok() && textures.exact) status = record_verification(textures, plan, table);
  if (!status.ok()) return status;
  recorder_.barrier_to_host();
  if (absl::Status done = recorder_.submit_and_wait(); !done.ok()) return done;
  add_timings(recorder_, stages);
  return plan.resolve.inputs.constants.wide != 0 ? drawn_from_tiles(textures) : Drawn{};
}

absl::Status DeviceExecutor::record_passes(const FrameTextures& textures, const Plan& plan,
                                           const Buffer* table) {
  if (plan.resolve.inputs.constants.wide != 0) {  // what metering found is read; resolve counts from 0
    recorder_.fill_zero(textures.tiles.buffer());
    recorder_.barrier();
  }
  for (const BloomStep& step : plan.bloom_steps) {
    recorder_.mark(name(step.pass));
    if (absl::Status status = record_bloom(step, textures, pipelines_, recorder_); !status.ok())
      return status;
    recorder_.barrier();
  }
  recorder_.mark(name(Pass::kResolve));
  absl::Status status = record_resolve(plan.resolve, table, textures, pipelines_, recorder_);
  if (!status.ok()) return status;
  recorder_.barrier();
  if (textures.readback) {
    recorder_.mark("download");
    recorder_.copy(textures.output.buffer(), textures.readback.buffer(), textures.output.buffer().bytes());
    if (plan.resolve.inputs.constants.wide != 0) {
      read_back(textures.tiles, textures.tiles_readback, recorder_);
    }
  }
  return absl::OkStatus();
}

absl::Status DeviceExecutor::record_verification(const FrameTextures& textures, const Plan& plan,
                                                 const Buffer* table) {
  recorder_.mark("verify");
  absl::Status status = record_exact(plan.resolve, table, textures, pipelines_, recorder_);
  if (!status.ok()) return status;
  recorder_.barrier();
  read_back(textures.exact, textures.exact_readback, recorder_);
  if (plan.bloom()) read_back(textures.levels[0], textures.level_readback, recorder_);
  return absl::OkStatus();
}

}  // namespace candela
