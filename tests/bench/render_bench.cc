// Device time per stage, against a memcpy of the input frame measured in the same loop.
//
//   build/release/bin/render_bench            every size and scene
//   build/release/bin/render_bench --benchmark_filter=1920x1080
//   build/release/bin/render_bench device     the device's passes even where the host would make them
//
// Columns: medians in ms; `x_memcpy` is device time over the memcpy of the wire frame, `call` is the
// time that a program waits for copying the frame's pixels and for render(), and `cpu` is its processor time.
// `Time` is a whole turn of the loop, with the memcpy.
// "bright" is a scene with lights and bloom, "dim" is the same with nothing above the threshold. Both run in
// every tier. "tiles" has light above its threshold in 1 % of the tiles. At 1920x1080 the bright scene is
// also rendered with one setting changed at a time. More sizes in `standard` show that the time per pixel
// does not grow with the frame.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstring>
#include <ctime>
#include <map>
#include <string>
#include <vector>

#include "server/render/settings/tiers.h"
#include "tests/bench/workbench.h"
#include "tests/support/settings.h"

namespace candela::bench {
namespace {

using Steady = std::chrono::steady_clock;

double median(std::vector<double> values) {
  std::nth_element(values.begin(), values.begin() + static_cast<ptrdiff_t>(values.size() / 2), values.end());
  return values[values.size() / 2];
}

double ms_since(Steady::time_point start) {
  return std::chrono::duration<double, std::milli>(Steady::now() - start).count();
}

void run(benchmark::State& state, Renderer& renderer, const testing::WireFrame& frame,
         const Settings& settings) {
  absl::StatusOr<FrameMemory> memory = renderer.allocate(frame.desc, settings);
  if (!memory.ok()) {
    state.SkipWithError(memory.status().ToString().c_str());
    return;
  }
  std::vector<std::byte> copy(frame.pixels.size());
  std::map<std::string, std::vector<double>> times;
  for (auto _ : state) {
    const Steady::time_point copying = Steady::now();
    std::memcpy(copy.data(), frame.pixels.data(), copy.size());
    benchmark::DoNotOptimize(copy.data());
    times["memcpy"].push_back(ms_since(copying));
    const double cpu_before = cpu_ms();
    const Steady::time_point calling = Steady::now();
    copy_in(frame, *memory);
    const Steady::time_point rendering = Steady::now();
    const absl::StatusOr<FrameReport> report = renderer.render(*memory, settings);
    const double wall = ms_since(rendering);
    const double call = ms_since(calling);
    const double cpu = cpu_ms() - cpu_before;
    if (!report.ok()) {
      state.SkipWithError(report.status().ToString().c_str());
      return;
    }
    double device = 0;
    for (const StageTime& stage : report->stages) {
      times[stage.name].push_back(static_cast<double>(stage.ns) * 1e-6);
      device += static_cast<double>(stage.ns) * 1e-6;
    }
    times["device"].push_back(device);
    times["wall"].push_back(wall);
    times["call"].push_back(call);
    times["cpu"].push_back(cpu);
  }
  for (const auto& [name, values] : times) state.counters[name] = median(values);
  state.counters["x_memcpy"] = median(times["device"]) / median(times["memcpy"]);
}

int main_(int argc, char** argv) {
  benchmark::Initialize(&argc, argv);
  const absl::StatusOr<ExecutorKind> passes = parse_executor(argc > 1 ? argv[1] : "auto");
  if (!passes.ok()) {
    std::fprintf(stderr, "render_bench: %s is no word for the passes: %s\n", argv[1],
                 passes.status().ToString().c_str());
    return 2;
  }
  const absl::StatusOr<Workbench> bench = open_workbench(*passes);
  if (!bench.ok()) {
    std::fprintf(stderr, "render_bench: %s\n", bench.status().ToString().c_str());
    return 1;
  }
  const DeviceSummary& summary = bench->device->summary();
  benchmark::AddCustomContext("device", summary.name + " (" + summary.driver + ")");
  benchmark::AddCustomContext("passes", bench->renderer->executor_words());

  constexpr std::pair<uint32_t, uint32_t> kSizes[] = {{1280, 720}, {1920, 1080}, {3840, 2160}};
  constexpr std::pair<uint32_t, uint32_t> kMoreSizes[] = {{640, 400},   {1366, 768},  {1919, 1081},
                                                          {2560, 1440}, {5120, 2880}, {7680, 4320},
                                                          {7681, 4321}, {16384, 2025}};
  using Scene = testing::WireFrame (*)(uint32_t, uint32_t);
  constexpr Scene kNatural = [](uint32_t width, uint32_t height) { return natural_frame(width, height); };
  const auto add = [renderer = bench->renderer.get()](uint32_t width, uint32_t height,
                                                      const std::string& what, Scene scene,
                                                      const v1::Settings& settings) {
    benchmark::RegisterBenchmark((std::to_string(width) + "x" + std::to_string(height) + "/" + what).c_str(),
                                 [=](benchmark::State& state) {
                                   run(state, *renderer, scene(width, height), testing::checked(settings));
                                 })
        ->UseRealTime()
        ->Unit(benchmark::kMillisecond)
        ->MinWarmUpTime(0.2)  // compiles the shaders
        ->MinTime(1.0);
  };
  for (const auto& [width, height] : kSizes) {
    for (const Tier& tier : tiers()) {
      v1::Settings settings;
      settings.set_tier(tier.name);
      add(width, height, std::string("bright/") + tier.name, kNatural, settings);
      settings.mutable_bloom()->set_threshold(kNothingBright);
      add(width, height, std::string("dim/") + tier.name, kNatural, settings);
    }
    v1::Settings settings;
    settings.mutable_bloom()->set_threshold(kLightsOnly);
    add(width, height, std::string("tiles/") + Settings().tier().name, tiles_frame, settings);
  }
  for (const auto& [width, height] : kMoreSizes) {
    v1::Settings settings;
    add(width, height, std::string("bright/") + Settings().tier().name, kNatural, settings);
    settings.mutable_bloom()->set_threshold(kNothingBright);
    add(width, height, std::string("dim/") + Settings().tier().name, kNatural, settings);
  }
  for (const auto& [what, change] : variants()) {
    v1::Settings settings;
    change(settings);
    add(1920, 1080, what, kNatural, settings);
  }
  benchmark::RunSpecifiedBenchmarks();
  benchmark::Shutdown();
  return 0;
}

}  // namespace
}  // namespace candela::bench

int main(int argc, char** argv) { return candela::bench::main_(argc, argv); }
