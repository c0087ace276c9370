// Renders a few kinds of frames, pass by pass, and views, for a tool that counts instructions:
// tests/bench/instructions.py runs it under callgrind. Prints the device in one line.
//
// Everything is rendered twice and counted the second time, so that the driver's compiler is not counted.
// Every pass is run separately, and its count is dumped as "KIND/PASS", once for each of its levels. If this
// machine's processor has the passes, too, theirs follow as "host KIND/PASS". valgrind knows no AVX-512, so
// they are counted with AVX2. With the argument `host`, those alone are rendered.
#include <valgrind/callgrind.h>

#include <cstdio>
#include <cstring>
#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "server/render/device/passes.h"
#include "server/render/environment/environment_baker.h"
#include "server/render/frame/frame_textures.h"
#include "server/render/host/bloom.h"
#include "server/render/host/host_executor.h"
#include "server/render/host/resolve.h"
#include "server/vulkan/pipeline.h"
#include "server/vulkan/recorder.h"
#include "tests/bench/workbench.h"
#include "tests/support/settings.h"

namespace candela::bench {
namespace {

constexpr uint32_t kWidth = 640;
constexpr uint32_t kHeight = 360;

// Runs one pass after another.
class Runner {
 public:
  virtual ~Runner() = default;
  virtual absl::Status use_tables(const Plan& plan) = 0;
  virtual absl::Status bloom(const BloomStep& step, const FrameTextures& textures) = 0;
  virtual absl::Status resolve(const ResolveStep& step, const FrameTextures& textures) = 0;
};

// With one submission for each.
class DeviceRunner final : public Runner {
 public:
  DeviceRunner(Device& device, PipelineCache pipelines, Recorder recorder)
      : pipelines_(std::move(pipelines)), recorder_(std::move(recorder)), tables_(device) {}

  absl::Status use_tables(const Plan& plan) override {
    colors_ = gain_ = nullptr;
    absl::Status status;
    const auto use = [&](const std::shared_ptr<const ColorTable>& table, std::shared_ptr<const Buffer>& to) {
      absl::StatusOr<std::shared_ptr<const Buffer>> points = tables_.get(table, recorder_);
      if (points.ok()) to = *std::move(points);
      status.Update(points.status());
    };
    if (plan.table) use(plan.table, colors_);
    if (plan.gain) use(plan.gain->pieces(), gain_);
    return status;
  }
  absl::Status bloom(const BloomStep& step, const FrameTextures& textures) override {
    return submit([&] {
      if (step.clear_first) {
        recorder_.fill_zero(textures.levels[step.level].buffer());
        recorder_.barrier();
      }
      return record_bloom(step, textures, pipelines_, recorder_);
    });
  }
  absl::Status resolve(const ResolveStep& step, const FrameTextures& textures) override {
    return submit([&] {
      return record_resolve(step, {colors_.get(), gain_.get()}, textures, pipelines_, recorder_);
    });
  }

 private:
  absl::Status submit(const std::function<absl::Status()>& record) {
    if (absl::Status status = recorder_.begin(); !status.ok()) return status;
    if (absl::Status status = record(); !status.ok()) return status;
    recorder_.barrier_to_host();
    return recorder_.submit_and_wait();
  }

  PipelineCache pipelines_;
  Recorder recorder_;
  TableCache tables_;
  std::shared_ptr<const Buffer> colors_, gain_;
};

class HostRunner final : public Runner {
 public:
  absl::Status use_tables(const Plan& plan) override {
    const auto use = [](const ColorTable* table, host::TablePoints& points) {
      points.resize(table != nullptr ? point_count(*table) : 0);
      if (table != nullptr) write_points(*table, reinterpret_cast<std::byte*>(points.data()));
    };
    use(plan.table.get(), colors_);
    use(plan.gain ? plan.gain->pieces().get() : nullptr, gain_);
    return absl::OkStatus();
  }
  absl::Status bloom(const BloomStep& step, const FrameTextures& textures) override {
    host::run_bloom(step, textures, crew_);
    return absl::OkStatus();
  }
  absl::Status resolve(const ResolveStep& step, const FrameTextures& textures) override {
    const host::Tables tables = {colors_.empty() ? nullptr : &colors_, gain_.empty() ? nullptr : &gain_};
    host::run_resolve(step, tables, textures, nullptr, crew_);
    return absl::OkStatus();
  }

 private:
  Crew crew_{1};
  host::TablePoints colors_, gain_;
};

absl::StatusOr<std::unique_ptr<Runner>> runner_of(const Workbench& bench) {
  if (bench.renderer->executor_kind() == ExecutorKind::kHost) return std::make_unique<HostRunner>();
  absl::StatusOr<PipelineCache> pipelines = PipelineCache::create(*bench.device);
  if (!pipelines.ok()) return pipelines.status();
  absl::StatusOr<Recorder> recorder = Recorder::create(*bench.device);
  if (!recorder.ok()) return recorder.status();
  return std::make_unique<DeviceRunner>(*bench.device, *std::move(pipelines), *std::move(recorder));
}

void instrument(bool on) {
  if (on) {
    CALLGRIND_START_INSTRUMENTATION;
  } else {
    CALLGRIND_STOP_INSTRUMENTATION;
  }
}

// `name` is "KIND/PASS". If nothing is counted, only calls `run`.
absl::Status counted(const std::string& name, const std::function<absl::Status()>& run) {
  CALLGRIND_ZERO_STATS;
  absl::Status status = run();
  CALLGRIND_DUMP_STATS_AT(name.c_str());
  return status;
}

// Renders a frame as Renderer does, but step by step.
absl::Status render(const Workbench& bench, Runner& runner, const testing::WireFrame& frame,
                    const std::string& kind, const Settings& settings) {
  absl::StatusOr<FrameMemory> memory = bench.renderer->allocate(frame.desc, settings);
  if (!memory.ok()) return memory.status();
  copy_in(frame, *memory);
  absl::StatusOr<Metered> metered;
  const auto meter = [&] { return (metered = bench.renderer->meter(*memory, settings)).status(); };
  if (absl::Status status = counted(kind + "/ingest", meter); !status.ok()) return status;

  const absl::StatusOr<std::shared_ptr<const ColorTable>> colors = color_table_of(settings, *metered);
  if (!colors.ok()) return colors.status();
  const FrameTextures& textures = memory->textures();
  const Plan plan = plan_frame(textures.layout, *metered, settings, {.table = *colors});
  if (absl::Status status = runner.use_tables(plan); !status.ok()) return status;
  for (const BloomStep& step : plan.bloom_steps) {
    absl::Status status = counted(kind + "/" + name(step.pass), [&] { return runner.bloom(step, textures); });
    if (!status.ok()) return status;
  }
  return counted(kind + "/" + name(Pass::kResolve), [&] { return runner.resolve(plan.resolve, textures); });
}

// Level 0 of the sky, the sky between levels, and spheres. `who` goes before their names.
absl::Status render_views(const Workbench& bench, const std::string& who) {
  EnvironmentBaker& baker = bench.renderer->baker();
  absl::StatusOr<Environment> environment = make_environment(baker, 512);
  if (!environment.ok()) return environment.status();
  absl::StatusOr<FrameMemory> memory =
      bench.renderer->allocate({kWidth, kHeight, v1::PIXEL_FORMAT_RGBA16F}, testing::checked(v1::Settings()));
  if (!memory.ok()) return memory.status();
  View sky;
  sky.camera.rotation = camera_rotation(20, 10, 0);
  View wide = sky;
  wide.camera.fov_deg = 150;
  View lookdev = sky;
  lookdev.objects = lookdev_objects();
  for (const bool count : {false, true}) {
    instrument(count);
    for (const auto& [name, view] : {std::pair("sky", &sky), {"wide", &wide}, {"lookdev", &lookdev}}) {
      const auto draw = [&, view = view] { return baker.render_view(*environment, *view, *memory); };
      if (absl::Status status = counted(who + name + "/view", draw); !status.ok()) return status;
    }
  }
  return absl::OkStatus();
}

// Renders every kind of frame. `who` goes before its name.
absl::Status render_all(const Workbench& bench, const std::string& who) {
  const absl::StatusOr<std::unique_ptr<Runner>> runner = runner_of(bench);
  if (!runner.ok()) return runner.status();
  const testing::WireFrame frame = natural_frame(kWidth, kHeight);
  const testing::WireFrame with_alpha = testing::natural(kWidth, kHeight);
  // This frame is larger, so that there is an area without light.
  const testing::WireFrame tiles = tiles_frame(2 * kWidth, 2 * kHeight);
  std::vector<Variant> kinds = {
      {"bright", [](v1::Settings&) {}},
      {"dim", [](v1::Settings& s) { s.mutable_bloom()->set_threshold(kNothingBright); }},
      {"draft", [](v1::Settings& s) { s.set_tier("draft"); }}};
  kinds.insert(kinds.end(), variants().begin(), variants().end());
  for (const bool count : {false, true}) {
    instrument(count);
    for (const Variant& kind : kinds) {
      v1::Settings settings;
      kind.change(settings);
      if (absl::Status status = render(bench, **runner, frame, who + kind.name, testing::checked(settings));
          !status.ok())
        return status;
    }
    v1::Settings straight;
    straight.set_alpha(v1::ALPHA_STRAIGHT);
    if (absl::Status status =
            render(bench, **runner, with_alpha, who + "straight", testing::checked(straight));
        !status.ok())
      return status;
    v1::Settings settings;
    settings.mutable_bloom()->set_threshold(kLightsOnly);
    if (absl::Status status = render(bench, **runner, tiles, who + "tiles", testing::checked(settings));
        !status.ok())
      return status;
  }
  return absl::OkStatus();
}

absl::Status render_both(bool host_only) {
  absl::StatusOr<Workbench> bench =
      open_workbench(host_only ? ExecutorKind::kHost : ExecutorKind::kDevice, /*threads=*/host_only ? 1 : 0);
  if (!bench.ok()) return bench.status();
  const DeviceSummary& summary = bench->device->summary();
  std::printf("%s (%s)\n", summary.name.c_str(), summary.driver.c_str());
  if (!host_only) {
    if (absl::Status status = render_all(*bench, ""); !status.ok()) return status;
    if (absl::Status status = render_views(*bench, ""); !status.ok()) return status;
    if (!HostExecutor::unavailable(summary).empty()) return absl::OkStatus();
    bench = absl::CancelledError();  // ends its parts before the device that they need
    bench = open_workbench(ExecutorKind::kHost, /*threads=*/1);
    if (!bench.ok()) return bench.status();
  }
  if (absl::Status status = render_all(*bench, "host "); !status.ok()) return status;
  return render_views(*bench, "host ");
}

int main_(int argc, char** argv) {
  const absl::Status status = render_both(argc > 1 && std::string(argv[1]) == "host");
  if (!status.ok()) std::fprintf(stderr, "render_counted: %s\n", status.ToString().c_str());
  return status.ok() ? 0 : 1;
}

}  // namespace
}  // namespace candela::bench

int main(int argc, char** argv) { return candela::bench::main_(argc, argv); }
