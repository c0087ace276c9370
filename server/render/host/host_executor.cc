#include "server/render/host/host_executor.h"

#include "server/render/host/targets.h"
// Only after targets.h.
#include <hwy/targets.h>

#include <algorithm>
#include <cstring>
#include <utility>

#include "absl/strings/str_cat.h"
#include "server/base/status_macros.h"
#include "server/render/frame/frame_textures.h"
#include "server/render/frame/tile_sums.h"
#include "server/render/host/bloom.h"
#include "server/render/host/ingest.h"
#include "server/render/host/resize.h"
#include "server/render/plan/exposure.h"

namespace candela {

namespace host {

namespace {

// Clears the histogram, so make it before the first tile is metered. It points into the textures, which are
// mapped and outlive it. sum_tiles() reads the result.
IngestWork ingest_work(const IngestPlan& plan, const IngestRead& read, const FrameTextures& textures) {
  IngestWork work{.constants = plan.inputs.constants, .params = plan.inputs.params};
  work.constants.scrub = read.scrub;
  work.constants.alpha = read.alpha;
  work.wire = textures.input.buffer().mapped();
  work.tiles = reinterpret_cast<shader::TileRecord*>(textures.tiles.buffer().mapped());
  if (work.constants.weights == shader::WEIGHTS_CENTER) work.center_weights = center_weights();
  if (textures.histogram) {
    std::byte* bins = textures.histogram.buffer().mapped();
    std::memset(bins, 0, textures.layout.histogram_bytes(read.scrub));
    work.histogram = reinterpret_cast<shader::HistogramBin*>(bins);
  }
  return work;
}

}  // namespace

const char* instruction_set() {
  const int64_t targets = hwy::SupportedTargets() & HWY_TARGETS;
  if ((targets & HWY_AVX3) != 0) return "AVX-512";
  if ((targets & HWY_AVX2) != 0) return "AVX2";
  return (targets & HWY_NEON) != 0 ? "NEON" : nullptr;
}

}  // namespace host

std::string HostExecutor::unavailable(const DeviceSummary& device) {
  if (device.type != "CPU") return absl::StrCat(device.name, " is not a CPU but a ", device.type);
  if (!device.unified_memory) return absl::StrCat("the memory of ", device.name, " is not the host's");
  if (host::instruction_set() == nullptr) return "this processor has no vectors with fused multiply-add";
  return "";
}

absl::Status HostExecutor::usable() const {
  if (!device_.lost()) return absl::OkStatus();
  return absl::UnavailableError(absl::StrCat("device lost: ", device_.summary().name));
}

absl::StatusOr<Metered> HostExecutor::run_meter(FrameMemory& memory, const IngestPlan& plan) {
  RETURN_IF_ERROR(usable());
  FrameTextures& textures = memory.textures();
  return meter_frame(
      plan, textures.layout.desc,
      [&](const IngestRead& read, bool, std::vector<StageTime>* stages) -> absl::StatusOr<TileSums> {
        const HostStage stage(name(Pass::kIngest), stages);
        const host::IngestWork work = host::ingest_work(plan, read, textures);
        // A second read finds them in the texture: the client may have changed its own.
        ClientPixels from = textures.client;
        textures.client.rows = nullptr;
        crew_.run(textures.layout.tiles_y, [&](uint32_t row) {
          if (from.rows != nullptr) {
            const uint32_t first = row * shader::TILE_TEXELS;
            textures.copy_rows(from, first,
                               std::min(first + shader::TILE_TEXELS, textures.layout.desc.height));
          }
          host::ingest_tiles(work, row);
        });
        return sum_tiles(textures, plan, read);
      });
}

absl::StatusOr<Drawn> HostExecutor::run_draw(FrameMemory& memory, const Plan& plan,
                                             std::vector<StageTime>* stages) {
  RETURN_IF_ERROR(usable());
  FrameTextures& textures = memory.textures();
  textures.planar_levels = true;
  for (const BloomStep& step : plan.bloom_steps) {
    const HostStage stage(name(step.pass), stages);
    host::run_bloom(step, textures, crew_);
  }
  if (plan.resize) {
    const HostStage stage(name(Pass::kResize), stages);
    host::run_resize(*plan.resize, textures, crew_);
  }
  const std::shared_ptr<const host::TablePoints> points = points_of(plan.table);
  const std::shared_ptr<const host::TablePoints> gain = points_of(plan.gain ? plan.gain->pieces() : nullptr);
  const host::Tables tables = {points.get(), gain.get()};
  Drawn drawn;
  {
    const HostStage stage(name(Pass::kResolve), stages);
    // Verification reads the image again, so it may not be where its client can change it.
    const bool to_client = textures.client.image != nullptr && !textures.exact;
    drawn =
        host::run_resolve(plan.resolve, tables, textures, to_client ? textures.client.image : nullptr, crew_);
    textures.client_has_image = to_client;
  }
  if (textures.exact) {
    const HostStage stage("verify", stages);
    host::run_exact(plan.resolve, tables, textures, crew_);
  }
  return drawn;
}

std::shared_ptr<const host::TablePoints> HostExecutor::points_of(
    const std::shared_ptr<const ColorTable>& table) {
  if (!table) return nullptr;
  if (std::shared_ptr<const host::TablePoints> found = tables_.find(table)) return found;
  tables_.make_room();
  host::TablePoints points(point_count(*table));
  write_points(*table, reinterpret_cast<std::byte*>(points.data()));
  return tables_.keep(table, std::move(points));
}

}  // namespace candela
