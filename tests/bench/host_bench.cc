// The time of each pass on the device and on the host, in turn in one run, so that other programs' load falls
// on all of them.
//
//   build/release/bin/host_bench [SECONDS [KIND]]    for each kind of frame, or only one; 5 by default
//
// "views" is all kinds of views, "sizes" all images of another size. Prints ms, median and least, at
// 1920x1080 or a view's own size with the device, with one thread of the host and with two; "cpu" is the
// processor time of the whole frame.
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <map>
#include <string>
#include <vector>

#include "proto/candela/v1/settings.h"
#include "server/render/device/device_executor.h"
#include "server/render/host/host_executor.h"
#include "tests/bench/workbench.h"
#include "tests/support/settings.h"

namespace candela::bench {
namespace {

using Steady = std::chrono::steady_clock;

struct Maker {
  std::string name;
  std::unique_ptr<Executor> executor;
  std::unique_ptr<Crew> crew;  // of the baker; null: the device's
  std::unique_ptr<EnvironmentBaker> baker;
  std::map<std::string, std::vector<double>> ms;  // by pass, "all" and "cpu"
};

absl::StatusOr<std::vector<Maker>> makers_on(const Workbench& bench) {
  Device& device = *bench.device;
  absl::StatusOr<std::unique_ptr<DeviceExecutor>> executor = DeviceExecutor::create(device);
  if (!executor.ok()) return executor.status();
  std::vector<Maker> makers;
  makers.push_back({"device", *std::move(executor), nullptr, nullptr, {}});
  makers.push_back(
      {"host, 1 thread", std::make_unique<HostExecutor>(device, 1), std::make_unique<Crew>(1), nullptr, {}});
  makers.push_back(
      {"host, 2 threads", std::make_unique<HostExecutor>(device, 2), std::make_unique<Crew>(2), nullptr, {}});
  for (Maker& maker : makers) {
    auto baker = EnvironmentBaker::create(device, *bench.pool, maker.crew.get());
    if (!baker.ok()) return baker.status();
    maker.baker = *std::move(baker);
  }
  return makers;
}

// What the pixels come from, unless they are in memory already.
struct Source {
  Environment* environment = nullptr;
  View view;
};

// Renders once. The times count unless the executor is still warming up.
absl::Status render(Maker& maker, FrameMemory& memory, const Source& source, const Settings& settings,
                    bool counts) {
  const TextureLayout& layout = memory.textures().layout;
  const double cpu_before = cpu_ms();
  std::vector<StageTime> stages;
  if (source.environment != nullptr) {
    const HostStage stage("view", &stages);
    absl::Status status = maker.baker->render_view(*source.environment, source.view, memory);
    if (!status.ok()) return status;
  }
  absl::StatusOr<Metered> metered = maker.executor->meter(memory, plan_ingest(layout, settings));
  if (!metered.ok()) return metered.status();
  const absl::StatusOr<std::shared_ptr<const ColorTable>> colors = color_table_of(settings, *metered);
  if (!colors.ok()) return colors.status();
  stages.insert(stages.end(), metered->stages.begin(), metered->stages.end());
  const Plan plan =
      plan_frame(layout, *metered, settings, {.table = *colors});
  if (const auto drawn = maker.executor->draw(memory, plan, &stages); !drawn.ok()) return drawn.status();
  const double cpu = cpu_ms() - cpu_before;
  if (!counts) return absl::OkStatus();
  double all = 0;
  for (const StageTime& stage : stages) {
    maker.ms[stage.name].push_back(static_cast<double>(stage.ns) * 1e-6);
    all += static_cast<double>(stage.ns) * 1e-6;
  }
  maker.ms["all"].push_back(all);
  maker.ms["cpu"].push_back(cpu);
  return absl::OkStatus();
}

void print(const Maker& maker) {
  std::printf("  %-16s", maker.name.c_str());
  for (const char* pass : {"view", "ingest", "bright_pass", "bloom_down", "bloom_up", "gaussian", "resize",
                           "resolve", "all", "cpu"}) {
    const auto found = maker.ms.find(pass);
    if (found == maker.ms.end()) continue;
    std::vector<double> ms = found->second;
    std::sort(ms.begin(), ms.end());
    std::printf("  %s %.2f (%.2f)", pass, ms[ms.size() / 2], ms.front());
  }
  std::printf("\n");
}

absl::Status compare(const Workbench& bench, const std::string& what, FrameMemory& memory,
                     const Source& source, const Settings& settings, double seconds) {
  absl::StatusOr<std::vector<Maker>> makers = makers_on(bench);
  if (!makers.ok()) return makers.status();
  const Steady::time_point begin = Steady::now();
  for (int round = 0; Steady::now() - begin < std::chrono::duration<double>(seconds) || round < 5; ++round) {
    for (Maker& maker : *makers) {
      absl::Status status = render(maker, memory, source, settings, round > 1);
      if (!status.ok()) return status;
    }
  }
  std::printf("%s\n", what.c_str());
  for (const Maker& maker : *makers) print(maker);
  std::fflush(stdout);
  return absl::OkStatus();
}

absl::Status compare_frame(const Workbench& bench, const std::string& what, const testing::WireFrame& frame,
                           const Settings& settings, double seconds) {
  absl::StatusOr<FrameMemory> memory = bench.renderer->allocate(frame.desc, settings);
  if (!memory.ok()) return memory.status();
  copy_in(frame, *memory);
  return compare(bench, what, *memory, {}, settings, seconds);
}

// Skies and spheres, with nothing that blooms.
absl::Status compare_views(const Workbench& bench, double seconds, const std::string& only) {
  v1::Settings dim;
  dim.mutable_bloom()->set_threshold(kNothingBright);
  const Settings settings = testing::checked(dim);
  View sky;
  sky.camera.rotation = camera_rotation(20, 10, 0);
  View lookdev = sky;
  lookdev.objects = lookdev_objects();
  View sampled = lookdev;
  sampled.samples = 4;
  struct Kind {
    const char* name;
    uint32_t panorama, width, height;
    const View* view;
  };
  for (const Kind& kind : {Kind{"sky", 1024, 1920, 1080, &sky},
                           {"sky of a large panorama", 4096, 1920, 1080, &sky},
                           {"small sky", 1024, 1280, 720, &sky},
                           {"lookdev", 1024, 1280, 720, &lookdev},
                           {"lookdev, four samples", 1024, 1280, 720, &sampled}}) {
    if (!only.empty() && only != kind.name && only != "views") continue;
    absl::StatusOr<Environment> environment = make_environment(bench.renderer->baker(), kind.panorama);
    if (!environment.ok()) return environment.status();
    absl::StatusOr<FrameMemory> memory =
        bench.renderer->allocate({kind.width, kind.height, v1::PIXEL_FORMAT_RGBA16F}, settings);
    if (!memory.ok()) return memory.status();
    absl::Status status = compare(bench, kind.name, *memory, {&*environment, *kind.view}, settings, seconds);
    if (!status.ok()) return status;
  }
  return absl::OkStatus();
}

// `only`: the kind of frame; empty: all.
absl::Status compare_all(double seconds, const std::string& only) {
  const absl::StatusOr<Workbench> bench = open_workbench(ExecutorKind::kDevice, 0);
  if (!bench.ok()) return bench.status();
  const DeviceSummary& summary = bench->device->summary();
  if (const std::string why = HostExecutor::unavailable(summary); !why.empty()) {
    return absl::FailedPreconditionError(why);
  }
  std::printf("%s (%s); ms, median (least)\n", summary.name.c_str(), summary.driver.c_str());
  const testing::WireFrame frame = natural_frame(1920, 1080);
  const auto run = [&](const std::string& what, const testing::WireFrame& of, const v1::Settings& settings) {
    if (!only.empty() && what != only) return absl::OkStatus();
    return compare_frame(*bench, what, of, testing::checked(settings), seconds);
  };
  v1::Settings settings;
  absl::Status status = run("bright", frame, settings);
  settings.set_tier("draft");
  status.Update(run("bright, draft", frame, settings));
  settings = {};
  settings.mutable_bloom()->set_threshold(kNothingBright);
  status.Update(run("dim", frame, settings));
  settings.mutable_bloom()->set_threshold(kLightsOnly);
  status.Update(run("tiles", tiles_frame(1920, 1080), settings));
  for (const auto& [what, change] : variants()) {
    change(settings = {});
    status.Update(run(what, frame, settings));
  }
  for (const auto format : {v1::PIXEL_FORMAT_RGBA32F, v1::PIXEL_FORMAT_RGB9E5}) {
    const testing::WireFrame other = natural_frame(1920, 1080, format);
    status.Update(run(std::string("bright, ") + v1::word_of(format), other, {}));
  }
  struct Resized {
    const char* what;
    uint32_t width, height, to_width, to_height;
  };
  for (const Resized& r : {Resized{"4K", 3840, 2160, 0, 0},
                           {"4K to 480x270", 3840, 2160, 480, 270},
                           {"4K to 500x281", 3840, 2160, 500, 281},
                           {"to 1000x563", 1920, 1080, 1000, 563},
                           {"to 480x270", 1920, 1080, 480, 270},
                           {"to 3840x2160", 1920, 1080, 3840, 2160}}) {
    if (!only.empty() && only != r.what && only != "sizes") continue;
    v1::Settings sized;
    sized.mutable_output_size()->set_width(r.to_width);
    sized.mutable_output_size()->set_height(r.to_height);
    status.Update(
        compare_frame(*bench, r.what, natural_frame(r.width, r.height), testing::checked(sized), seconds));
  }
  status.Update(compare_views(*bench, seconds, only));
  return status;
}

}  // namespace
}  // namespace candela::bench

int main(int argc, char** argv) {
  const absl::Status status =
      candela::bench::compare_all(argc > 1 ? std::atof(argv[1]) : 5.0, argc > 2 ? argv[2] : "");
  if (!status.ok()) std::fprintf(stderr, "host_bench: %s\n", status.ToString().c_str());
  return status.ok() ? 0 : 1;
}
