#include "server/render/renderer.h"

#include <utility>

#include "server/render/device/device_executor.h"
#include "server/render/device/frame_textures.h"
#include "server/render/plan/texture_layout.h"
#include "server/render/reference/reference_executor.h"
#include "server/render/reference/verify.h"

namespace candela {

Renderer::Renderer(Device& device, TexturePool& pool, std::unique_ptr<Executor> by_device)
    : device_(device),
      pool_(pool),
      by_device_(std::move(by_device)),
      by_reference_(std::make_unique<ReferenceExecutor>(*by_device_)) {}

Renderer::~Renderer() = default;

absl::StatusOr<std::unique_ptr<Renderer>> Renderer::create(Device& device, TexturePool& pool) {
  absl::StatusOr<std::unique_ptr<DeviceExecutor>> executor = DeviceExecutor::create(device);
  if (!executor.ok()) return executor.status();
  return std::unique_ptr<Renderer>(new Renderer(device, pool, *std::move(executor)));
}

absl::StatusOr<FrameMemory> Renderer::allocate(const FrameDesc& desc, const Settings& settings,
                                               Verify verify) {
  return FrameMemory::take(pool_, device_.summary(), layout_textures(desc, settings), verify);
}

Executor& Renderer::executor_of(const FrameMemory& memory) const {
  return memory.textures().layout.by_reference ? *by_reference_ : *by_device_;
}

absl::StatusOr<FrameReport> Renderer::render(FrameMemory& memory, const Settings& settings,
                                             const FrameMoment& moment) {
  const absl::StatusOr<Metered> metered = meter(memory, settings);
  if (!metered.ok()) return metered.status();
  const Exposed exposed = expose(settings->exposure(), moment.previous, metered->stats.metered_mean());
  return draw(memory, settings, moment.sequence, *metered, exposed);
}

absl::StatusOr<Metered> Renderer::meter(FrameMemory& memory, const Settings& settings) {
  return executor_of(memory).meter(memory, plan_ingest(memory.textures().layout, settings));
}

absl::StatusOr<FrameReport> Renderer::draw(FrameMemory& memory, const Settings& settings, uint64_t sequence,
                                           const Metered& metered, const Exposed& exposed) {
  absl::StatusOr<std::shared_ptr<const ColorTable>> table = color_table_of(settings, metered);
  if (!table.ok()) return table.status();
  FrameReport report;
  report.stats = metered.stats;
  report.exposure = exposed.exposure;
  report.target = exposed.target;
  report.target_before_limits = exposed.target_before_limits;
  report.stages = metered.stages;
  report.plan = plan_frame(memory.textures().layout, metered, settings,
                           {.exposure = exposed.exposure, .sequence = sequence, .table = *std::move(table)});
  const absl::StatusOr<uint64_t> cut = executor_of(memory).draw(memory, report.plan, &report.stages);
  if (!cut.ok()) return cut.status();
  report.gamut_cut_components = *cut;
  if (memory.textures().exact) {
    const HostStage stage("verify", &report.stages);
    report.verification = verify_frame(memory, report.plan, report.stats);
  }
  return report;
}

}  // namespace candela
