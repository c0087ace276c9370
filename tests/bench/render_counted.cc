// Renders a few kinds of frames, pass by pass, and views, for a tool that counts instructions:
// tests/bench/instructions.py runs it under callgrind. Prints the device in one line.
//
// Everything is rendered twice and counted the second time, so that the driver's compiler is not counted.
// Every pass is submitted separately, and its count is dumped as "KIND/PASS", once for each of its levels.
#include <valgrind/callgrind.h>

#include <cstdio>
#include <cstring>
#include <functional>
#include <string>
#include <vector>

#include "server/render/device/frame_textures.h"
#include "server/render/device/passes.h"
#include "server/render/device/table_cache.h"
#include "server/render/environment/environment_baker.h"
#include "server/render/settings/tiers.h"
#include "server/vulkan/pipeline.h"
#include "server/vulkan/recorder.h"
#include "tests/bench/workbench.h"
#include "tests/support/settings.h"

namespace candela::bench {
namespace {

constexpr uint32_t kWidth = 640;
constexpr uint32_t kHeight = 360;

struct Passes {
  PipelineCache pipelines;
  Recorder recorder;
  TableCache tables;
};

// `name` is "KIND/PASS". If nothing is counted, only calls `run`.
absl::Status counted(const std::string& name, const std::function<absl::Status()>& run) {
  CALLGRIND_ZERO_STATS;
  absl::Status status = run();
  CALLGRIND_DUMP_STATS_AT(name.c_str());
  return status;
}

// Renders a frame as Renderer does, but with one submission for each step.
absl::Status render(const Workbench& bench, Passes& passes, const testing::WireFrame& frame,
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
  absl::StatusOr<const Buffer*> table = nullptr;
  if (plan.table) table = passes.tables.get(plan.table, passes.recorder);
  if (!table.ok()) return table.status();
  const auto submit = [&](Pass pass, const std::function<absl::Status()>& record) {
    return counted(kind + "/" + name(pass), [&] {
      if (absl::Status status = passes.recorder.begin(); !status.ok()) return status;
      if (absl::Status status = record(); !status.ok()) return status;
      passes.recorder.barrier_to_host();
      return passes.recorder.submit_and_wait();
    });
  };
  for (const BloomStep& step : plan.bloom_steps) {
    absl::Status status =
        submit(step.pass, [&] { return record_bloom(step, textures, passes.pipelines, passes.recorder); });
    if (!status.ok()) return status;
  }
  return submit(Pass::kResolve, [&] {
    return record_resolve(plan.resolve, *table, textures, passes.pipelines, passes.recorder);
  });
}

// A panorama with what its views read.
absl::StatusOr<Environment> make_environment(EnvironmentBaker& baker) {
  const auto scene = testing::ordinary(scenes::natural(512, 256));
  const testing::WireFrame frame = testing::make_frame(512, 256, v1::PIXEL_FORMAT_RGBA16F, scene);
  absl::StatusOr<PanoramaUpload> upload = baker.take(frame.desc);
  if (!upload.ok()) return upload.status();
  const uint64_t row_bytes = frame.desc.row_bytes();
  for (uint32_t y = 0; y < frame.desc.height; ++y) {
    std::memcpy(upload->row(y).data(), frame.pixels.data() + y * row_bytes, row_bytes);
  }
  absl::StatusOr<Environment> environment = baker.finish(*std::move(upload), std::nullopt);
  if (!environment.ok()) return environment.status();
  const Tier& draft = tiers().front();
  absl::Status status = baker.prepare_view(*environment, {draft.cube_samples, draft.specular_detail});
  if (status.ok()) status = baker.radiance(*environment).status();
  if (!status.ok()) return status;
  return environment;
}

// Level 0 of the sky, the sky between levels, and spheres.
absl::Status render_views(const Workbench& bench, EnvironmentBaker& baker, Environment& environment) {
  absl::StatusOr<FrameMemory> memory =
      bench.renderer->allocate({kWidth, kHeight, v1::PIXEL_FORMAT_RGBA16F}, testing::checked(v1::Settings()));
  if (!memory.ok()) return memory.status();
  View sky;
  sky.camera.rotation = camera_rotation(20, 10, 0);
  View wide = sky;
  wide.camera.fov_deg = 150;
  View lookdev = sky;
  lookdev.objects = lookdev_objects();
  for (const auto& [name, view] : {std::pair("sky", &sky), {"wide", &wide}, {"lookdev", &lookdev}}) {
    const auto draw = [&, view = view] { return baker.render_view(environment, *view, *memory); };
    if (absl::Status status = counted(std::string(name) + "/view", draw); !status.ok()) return status;
  }
  return absl::OkStatus();
}

absl::Status render_all() {
  const absl::StatusOr<Workbench> bench = open_workbench();
  if (!bench.ok()) return bench.status();
  const DeviceSummary& summary = bench->device->summary();
  std::printf("%s (%s)\n", summary.name.c_str(), summary.driver.c_str());
  absl::StatusOr<PipelineCache> pipelines = PipelineCache::create(*bench->device);
  if (!pipelines.ok()) return pipelines.status();
  absl::StatusOr<Recorder> recorder = Recorder::create(*bench->device);
  if (!recorder.ok()) return recorder.status();
  Passes passes{*std::move(pipelines), *std::move(recorder), TableCache(*bench->device)};
  constexpr v1::PixelFormat kFormat = v1::PIXEL_FORMAT_RGBA16F;
  const auto scene = testing::ordinary(scenes::natural(kWidth, kHeight));
  const testing::WireFrame frame = testing::make_frame(kWidth, kHeight, kFormat, scene);
  const testing::WireFrame with_alpha = testing::natural(kWidth, kHeight);
  // This frame is larger, so that there is an area without light.
  const auto lights = testing::ordinary(scenes::lit_tiles(2 * kWidth, 2 * kHeight));
  const testing::WireFrame tiles = testing::make_frame(2 * kWidth, 2 * kHeight, kFormat, lights);
  std::vector<Variant> kinds = {
      {"bright", [](v1::Settings&) {}},
      {"dim", [](v1::Settings& s) { s.mutable_bloom()->set_threshold(kNothingBright); }},
      {"draft", [](v1::Settings& s) { s.set_tier("draft"); }}};
  kinds.insert(kinds.end(), variants().begin(), variants().end());
  const absl::StatusOr<std::unique_ptr<EnvironmentBaker>> baker =
      EnvironmentBaker::create(*bench->device, *bench->pool);
  if (!baker.ok()) return baker.status();
  absl::StatusOr<Environment> environment = make_environment(**baker);
  if (!environment.ok()) return environment.status();
  for (const bool count : {false, true}) {
    if (count) CALLGRIND_START_INSTRUMENTATION;
    for (const Variant& kind : kinds) {
      v1::Settings settings;
      kind.change(settings);
      if (absl::Status status = render(*bench, passes, frame, kind.name, testing::checked(settings));
          !status.ok())
        return status;
    }
    v1::Settings straight;
    straight.set_alpha(v1::ALPHA_STRAIGHT);
    if (absl::Status status = render(*bench, passes, with_alpha, "straight", testing::checked(straight));
        !status.ok())
      return status;
    v1::Settings settings;
    settings.mutable_bloom()->set_threshold(kLightsOnly);
    if (absl::Status status = render(*bench, passes, tiles, "tiles", testing::checked(settings));
        !status.ok())
      return status;
    if (absl::Status status = render_views(*bench, **baker, *environment); !status.ok()) return status;
  }
  return absl::OkStatus();
}

int main_() {
  const absl::Status status = render_all();
  if (!status.ok()) std::fprintf(stderr, "render_counted: %s\n", status.ToString().c_str());
  return status.ok() ? 0 : 1;
}

}  // namespace
}  // namespace candela::bench

int main() { return candela::bench::main_(); }
