#include "server/render/device/device_executor.h"

#include <algorithm>
#include <utility>

#include "server/base/status_macros.h"
#include "server/render/device/passes.h"
#include "server/render/plan/exposure.h"

namespace candela {

namespace {

// Each takes 2 to 3 MB on the software device; clients choose the settings that they are made for.
constexpr size_t kMaxPipelines = 64;

// Before the pace of a pass is known, a texel counts as this slow. The software device takes 2 to 10 ns.
constexpr double kFirstPace = 20e-9;

GroupRows rows_of(uint64_t first, uint64_t last) {
  return {static_cast<uint32_t>(first), static_cast<uint32_t>(std::min<uint64_t>(last, UINT32_MAX))};
}

// The groups of resolve, with bloom and without.
std::vector<Box> groups_of(const ResolveStep& step) {
  std::vector<Box> groups = step.bloom_groups;
  groups.insert(groups.end(), step.plain_groups.begin(), step.plain_groups.end());
  return groups;
}

// Nothing on a device with unified memory, which has no copy to read.
void read_back(const TexturePool::Lease& from, const TexturePool::Lease& to, Recorder& recorder) {
  if (to) recorder.copy(from.buffer(), to.buffer(), to.buffer().bytes());
}

}  // namespace

DeviceExecutor::DeviceExecutor(Device& device, PipelineCache pipelines, Recorder recorder)
    : pipelines_(std::move(pipelines)), recorder_(std::move(recorder)), pace_(kFirstPace), tables_(device) {}

absl::StatusOr<std::unique_ptr<DeviceExecutor>> DeviceExecutor::create(Device& device) {
  ASSIGN_OR_RETURN(PipelineCache pipelines, PipelineCache::create(device));
  ASSIGN_OR_RETURN(Recorder recorder, Recorder::create(device));
  return std::unique_ptr<DeviceExecutor>(
      new DeviceExecutor(device, std::move(pipelines), std::move(recorder)));
}

absl::StatusOr<Metered> DeviceExecutor::run_meter(FrameMemory& memory, const IngestPlan& plan) {
  RETURN_IF_ERROR(recorder_.usable());
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
  Submissions submissions(recorder_, pace_, !textures.upload, stages);
  absl::Status status = submissions.begin();
  if (!status.ok()) return status;
  if (upload && textures.upload) {
    const Buffer& to = textures.input.buffer();
    status = submissions.copy("upload", to.bytes(), [&](uint64_t first, uint64_t last) {
      recorder_.copy_part(textures.upload.buffer(), to, first, last - first);
      return absl::OkStatus();
    });
    if (!status.ok()) return status;
  }
  recorder_.mark(name(Pass::kIngest));
  recorder_.fill_zero(textures.tiles.buffer());
  if (textures.histogram) {
    recorder_.fill_zero(textures.histogram.buffer(), 0, textures.layout.histogram_bytes(read.scrub));
  }
  if (textures.center_weights) {
    const std::vector<uint32_t>& weights = center_weights();
    recorder_.update(textures.center_weights.buffer(), weights.data(), weights.size() * sizeof weights[0]);
  }
  recorder_.barrier();
  const Box groups = ingest_groups(textures.layout);
  status = submissions.pass(
      name(Pass::kIngest), {&groups, 1}, kIngestGroupTexels, [&](uint64_t first, uint64_t last) {
        return record_ingest(plan, read, textures, pipelines_, recorder_, rows_of(first, last));
      });
  if (!status.ok()) return status;
  if (textures.tiles_readback) {
    recorder_.barrier();
    read_back(textures.tiles, textures.tiles_readback, recorder_);
    read_back(textures.histogram, textures.histogram_readback, recorder_);
  }
  RETURN_IF_ERROR(submissions.end());
  return sum_tiles(textures, plan, read);
}

absl::StatusOr<Drawn> DeviceExecutor::run_draw(FrameMemory& memory, const Plan& plan,
                                               std::vector<StageTime>* stages) {
  RETURN_IF_ERROR(recorder_.usable());
  const FrameTextures& textures = memory.textures();
  pipelines_.trim(kMaxPipelines);
  std::shared_ptr<const Buffer> colors, gain;
  if (plan.table) {
    ASSIGN_OR_RETURN(colors, tables_.get(plan.table, recorder_));
  }
  if (plan.gain) {
    ASSIGN_OR_RETURN(gain, tables_.get(plan.gain->pieces(), recorder_));
  }
  const TableBuffers tables = {colors.get(), gain.get()};
  Submissions submissions(recorder_, pace_, !textures.upload, stages);
  absl::Status status = submissions.begin();
  if (status.ok()) status = record_passes(textures, plan, tables, submissions);
  if (status.ok() && textures.exact) status = record_verification(textures, plan, tables, submissions);
  if (status.ok()) status = submissions.end();
  if (!status.ok()) return status;
  return plan.resolve.inputs.constants.wide != 0 ? drawn_from_tiles(textures) : Drawn{};
}

absl::Status DeviceExecutor::record_passes(const FrameTextures& textures, const Plan& plan,
                                           const TableBuffers& tables, Submissions& submissions) {
  if (plan.resolve.inputs.constants.wide != 0) {  // what metering found is read; resolve counts from 0
    recorder_.fill_zero(textures.tiles.buffer());
    recorder_.barrier();
  }
  for (const BloomStep& step : plan.bloom_steps) {
    RETURN_IF_ERROR(record_bloom_step(step, textures, submissions));
    recorder_.barrier();
  }
  if (plan.resize) RETURN_IF_ERROR(record_resized(*plan.resize, textures, submissions));
  const auto record = [&](uint64_t first, uint64_t last) {
    return record_resolve(plan.resolve, tables, textures, pipelines_, recorder_, rows_of(first, last));
  };
  absl::Status status =
      submissions.pass(name(Pass::kResolve), groups_of(plan.resolve), kResolveGroupTexels, record);
  if (!status.ok()) return status;
  recorder_.barrier();
  if (!textures.readback) return absl::OkStatus();
  const Buffer& from = textures.output.buffer();
  status = submissions.copy("download", from.bytes(), [&](uint64_t first, uint64_t last) {
    recorder_.copy_part(from, textures.readback.buffer(), first, last - first);
    return absl::OkStatus();
  });
  if (plan.resolve.inputs.constants.wide != 0) read_back(textures.tiles, textures.tiles_readback, recorder_);
  return status;
}

absl::Status DeviceExecutor::record_resized(const ResizeStep& step, const FrameTextures& textures,
                                            Submissions& submissions) {
  std::vector<float> weights = step.down.weights;
  weights.insert(weights.end(), step.across.weights.begin(), step.across.weights.end());
  if (!weights.empty()) {
    recorder_.update(textures.resize_weights.buffer(), weights.data(), weights.size() * sizeof weights[0]);
    recorder_.barrier();
  }
  const TextureLayout& layout = textures.layout;
  for (uint32_t block = 0; block < layout.image.height; block += layout.resize_rows) {
    for (const bool down : {true, false}) {
      const Box groups = resize_groups(step, down, block, layout);
      const auto record = [&](uint64_t first, uint64_t last) {
        return record_resize(step, down, block, textures, pipelines_, recorder_, rows_of(first, last));
      };
      RETURN_IF_ERROR(
          submissions.pass(name(Pass::kResize), {&groups, 1}, resize_group_texels(step, down), record));
      recorder_.barrier();
    }
  }
  return absl::OkStatus();
}

absl::Status DeviceExecutor::record_bloom_step(const BloomStep& step, const FrameTextures& textures,
                                               Submissions& submissions) {
  if (step.clear_first) {
    const Buffer& level = textures.levels[step.level].buffer();
    absl::Status cleared =
        submissions.copy(name(step.pass), level.bytes(), [&](uint64_t first, uint64_t last) {
          recorder_.fill_zero(level, first, last - first);
          return absl::OkStatus();
        });
    if (!cleared.ok()) return cleared;
    recorder_.barrier();
  }
  return submissions.pass(name(step.pass), step.groups, 1.0 * step.group_columns * step.group_rows,
                          [&](uint64_t first, uint64_t last) {
                            return record_bloom(step, textures, pipelines_, recorder_, rows_of(first, last));
                          });
}

absl::Status DeviceExecutor::record_verification(const FrameTextures& textures, const Plan& plan,
                                                 const TableBuffers& tables, Submissions& submissions) {
  const auto record = [&](uint64_t first, uint64_t last) {
    return record_exact(plan.resolve, tables, textures, pipelines_, recorder_, rows_of(first, last));
  };
  RETURN_IF_ERROR(submissions.pass("verify", groups_of(plan.resolve), kResolveGroupTexels, record));
  recorder_.barrier();
  read_back(textures.exact, textures.exact_readback, recorder_);
  if (plan.bloom()) read_back(textures.levels[0], textures.level_readback, recorder_);
  return absl::OkStatus();
}

}  // namespace candela
