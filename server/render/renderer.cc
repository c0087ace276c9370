#include "server/render/renderer.h"

#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "server/base/process.h"
#include "server/base/slices.h"
#include "server/base/status_macros.h"
#include "server/render/device/device_executor.h"
#include "server/render/environment/environment_baker.h"
#include "server/render/frame/frame_textures.h"
#include "server/render/host/host_executor.h"
#include "server/render/plan/plan.h"
#include "server/render/plan/texture_layout.h"
#include "server/render/reference/reference_executor.h"
#include "server/render/reference/verify.h"

namespace candela {

Renderer::Renderer(Device& device, TexturePool& pool) : device_(device), pool_(pool) {}

Renderer::~Renderer() = default;

absl::StatusOr<std::unique_ptr<Renderer>> Renderer::create(Device& device, TexturePool& pool,
                                                           ExecutorKind executor, uint32_t threads) {
  std::unique_ptr<Renderer> renderer(new Renderer(device, pool));
  RETURN_IF_ERROR(renderer->choose(executor, threads));
  return renderer;
}

absl::Status Renderer::choose(ExecutorKind kind, uint32_t threads) {
  const std::string not_on_host = HostExecutor::unavailable(device_.summary());
  const bool only_host = kind == ExecutorKind::kHost || device_.is_host();
  if (only_host && !not_on_host.empty()) {
    return absl::FailedPreconditionError(absl::StrCat("the host cannot make the passes: ", not_on_host));
  }
  if (device_.is_host() && kind == ExecutorKind::kDevice) {
    return absl::FailedPreconditionError(
        "the passes are to run on the device, and there is no Vulkan device: choose one");
  }
  Crew* crew = nullptr;
  if (kind != ExecutorKind::kDevice && not_on_host.empty()) {
    auto executor = std::make_unique<HostExecutor>(device_, threads == 0 ? usable_cpus() : threads);
    crew = &executor->crew();
    executor_kind_ = ExecutorKind::kHost;
    executor_words_ = absl::StrFormat("on the host, %s, %d thread%s", host::instruction_set(),
                                      crew->threads(), crew->threads() == 1 ? "" : "s");
    by_device_or_host_ = std::move(executor);
  } else {
    ASSIGN_OR_RETURN(by_device_or_host_, DeviceExecutor::create(device_));
    executor_kind_ = ExecutorKind::kDevice;
    executor_words_ = "on the device";
    if (kind == ExecutorKind::kAuto && device_.summary().type == "CPU") {
      absl::StrAppend(&executor_words_, ": ", not_on_host);
    }
  }
  by_reference_ = std::make_unique<ReferenceExecutor>(*by_device_or_host_);
  if (device_.is_host()) return absl::OkStatus();
  ASSIGN_OR_RETURN(baker_, EnvironmentBaker::create(device_, pool_, crew));
  return absl::OkStatus();
}

absl::StatusOr<FrameMemory> Renderer::allocate(const FrameDesc& desc, const Settings& settings,
                                               Verify verify) {
  return FrameMemory::take(pool_, device_.summary(), layout_textures(desc, settings), verify);
}

absl::StatusOr<uint64_t> Renderer::bytes_for(const FrameDesc& desc, const Settings& settings,
                                             Verify verify) const {
  return FrameMemory::bytes_for(pool_, device_.summary(), layout_textures(desc, settings), verify);
}

Executor& Renderer::executor_of(const FrameMemory& memory) const {
  return memory.textures().layout.by_reference ? *by_reference_ : *by_device_or_host_;
}

absl::StatusOr<Metered> Renderer::meter(FrameMemory& memory, const Settings& settings) {
  return executor_of(memory).meter(memory, plan_ingest(memory.textures().layout, settings));
}

absl::Status Renderer::check_environments() const {
  if (baker_ != nullptr) return absl::OkStatus();
  return absl::FailedPreconditionError(
      "this server has no Vulkan device, and only that bakes environments; use another server, or start "
      "this one without --device host");
}

absl::Status Renderer::prepare_view(Environment& environment, const BakeQuality& quality, bool objects) {
  return baker_->prepare_view(environment, quality, objects);
}

absl::Status Renderer::render_view(Environment& environment, const View& view, FrameMemory& memory) {
  return baker_->render_view(environment, view, memory);
}

absl::StatusOr<Drawn> Renderer::draw_image(FrameMemory& memory, const Settings& settings, uint64_t sequence,
                                           const Metered& metered, FrameReport& report) {
  ASSIGN_OR_RETURN(std::shared_ptr<const ColorTable> table, color_table_of(settings, metered));
  const TextureLayout& layout = memory.textures().layout;
  report.plan = plan_frame(layout, metered, settings,
                           {.exposure = report.exposure, .sequence = sequence, .table = std::move(table)});
  if (!layout.by_reference) report.plan.words.push_back(absl::StrCat("passes ", executor_words_));
  report.tier = settings.tier().name;
  const absl::StatusOr<Drawn> drawn = executor_of(memory).draw(memory, report.plan, &report.stages);
  if (drawn.ok()) report.gamut_cut_components = drawn->gamut_cut_components;
  if (drawn.ok() && is_hdr(*settings)) report.shown = drawn->shown;
  return drawn;
}

absl::Status Renderer::draw_within_error(FrameMemory& memory, const Settings& settings, uint64_t sequence,
                                         const Metered& metered, FrameReport& report) {
  BoundFacts facts = frame_facts(metered, settings, report.exposure, memory.desc());
  for (const Tier& tier : tiers_in_question(memory.desc(), settings)) {
    if (error_bound(tier, settings, facts) > settings->max_error_codes()) continue;
    checkpoint();
    const Settings tried = settings.with_tier(tier.name);
    // The tier's own: where it blooms it is the one that the memory was taken for.
    memory.textures().layout = layout_textures(memory.desc(), tried);
    ASSIGN_OR_RETURN(const Drawn drawn, draw_image(memory, tried, sequence, metered, report));
    if (facts.wide && !tier.host_reference) facts.negative_light = drawn.negative_light;
    const double bound = error_bound(tier, settings, facts);
    if (bound > settings->max_error_codes()) continue;
    report.error_bound = bound;
    report.tier_reason = reason_for(tier, bound, settings, facts);
    return absl::OkStatus();
  }
  return absl::InternalError("no tier is within max_error_codes, although the reference keeps every one");
}

absl::StatusOr<FrameReport> Renderer::draw(FrameMemory& memory, const Settings& settings, uint64_t sequence,
                                           const Metered& metered, const Exposed& exposed) {
  FrameReport report = report_of(metered, exposed);
  RETURN_IF_ERROR(settings.tier_is_open() ? draw_within_error(memory, settings, sequence, metered, report)
                                          : draw_image(memory, settings, sequence, metered, report).status());
  if (memory.textures().exact) {
    const HostStage stage("verify", &report.stages);
    report.verification = verify_frame(memory, report.plan, report.stats);
  }
  return report;
}

}  // namespace candela
