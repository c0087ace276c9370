// Device time per stage, against a memcpy of the input frame measured in the same loop.
//
//   build/release/bin/render_bench            every size and scene
//   build/release/bin/render_bench --benchmark_filter=1920x1080
//
// Columns: medians in ms; `x_memcpy` is device time over the memcpy of the wire frame. "bright" is a scene
// with lights and bloom, "dim" the same with nothing above the threshold; both in every tier. At 1920x1080
// the bright scene is also rendered with one setting changed at a time.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstring>
#include <map>
#include <string>
#include <vector>

#include "server/base/driver_environment.h"
#include "server/render/renderer.h"
#include "server/render/tiers.h"
#include "tests/support/scenes.h"

namespace candela {
namespace {

using Clock = std::chrono::steady_clock;

double median(std::vector<double> values) {
  std::nth_element(values.begin(), values.begin() + static_cast<ptrdiff_t>(values.size() / 2), values.end());
  return values[values.size() / 2];
}

double ms_since(Clock::time_point start) {
  return std::chrono::duration<double, std::milli>(Clock::now() - start).count();
}

struct Bench {
  std::unique_ptr<Device> device;
  std::unique_ptr<TexturePool> pool;
  std::unique_ptr<Renderer> renderer;
};

void run(benchmark::State& state, Bench& bench, uint32_t width, uint32_t height, const Settings& settings) {
  const testing::WireFrame frame = testing::natural(width, height);
  absl::StatusOr<FrameMemory> memory = bench.renderer->allocate(frame.desc, settings);
  if (!memory.ok()) {
    state.SkipWithError(memory.status().ToString().c_str());
    return;
  }
  std::vector<std::byte> copy(frame.pixels.size());
  std::map<std::string, std::vector<double>> times;
  for (auto _ : state) {
    const Clock::time_point copying = Clock::now();
    std::memcpy(copy.data(), frame.pixels.data(), copy.size());
    benchmark::DoNotOptimize(copy.data());
    times["memcpy"].push_back(ms_since(copying));
    for (uint32_t y = 0; y < height; ++y) {
      std::memcpy(memory->input_row(y).data(), copy.data() + y * frame.desc.row_bytes(),
                  frame.desc.row_bytes());
    }
    const Clock::time_point rendering = Clock::now();
    const absl::StatusOr<FrameReport> report = bench.renderer->render(*memory, settings);
    const double wall = ms_since(rendering);
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
    state.SetIterationTime(device * 1e-3);
  }
  for (const auto& [name, values] : times) state.counters[name] = median(values);
  state.counters["x_memcpy"] = median(times["device"]) / median(times["memcpy"]);
}

using Change = void (*)(Settings&);
constexpr std::pair<const char*, Change> kVariants[] = {
    {"conserve", [](Settings& s) { s.bloom.kind = BloomKind::kConserve; }},
    {"gaussian",
     [](Settings& s) {
       s.bloom.kind = BloomKind::kGaussian;
       s.bloom.threshold = 8.0f;
     }},
    {"centre", [](Settings& s) { s.exposure.metering.weights = MeterWeights::kCenter; }},
    {"percentile", [](Settings& s) { s.exposure.metering.statistic = MeterStatistic::kPercentile; }},
    {"dither", [](Settings& s) { s.dither = true; }},
    {"agx", [](Settings& s) { s.curve = ToneCurve::kAgx; }},
    {"aces-1", [](Settings& s) { s.curve = ToneCurve::kAces1; }},
    {"pbr-neutral", [](Settings& s) { s.curve = ToneCurve::kPbrNeutral; }},
};

int main_(int argc, char** argv) {
  benchmark::Initialize(&argc, argv);
  prepare_driver_environment();
  Bench bench;
  absl::StatusOr<std::unique_ptr<Device>> device = Device::create({});
  if (!device.ok()) {
    std::fprintf(stderr, "render_bench: %s\n", device.status().ToString().c_str());
    return 1;
  }
  bench.device = *std::move(device);
  bench.pool = std::make_unique<TexturePool>(*bench.device, uint64_t{4} << 30);
  absl::StatusOr<std::unique_ptr<Renderer>> renderer = Renderer::create(*bench.device, *bench.pool);
  if (!renderer.ok()) {
    std::fprintf(stderr, "render_bench: %s\n", renderer.status().ToString().c_str());
    return 1;
  }
  bench.renderer = *std::move(renderer);
  std::printf("device: %s (%s)\n", bench.device->summary().name.c_str(),
              bench.device->summary().driver.c_str());

  constexpr std::pair<uint32_t, uint32_t> kSizes[] = {{1280, 720}, {1920, 1080}, {3840, 2160}};
  const auto add = [&bench](uint32_t width, uint32_t height, const std::string& what,
                            const Settings& settings) {
    benchmark::RegisterBenchmark((std::to_string(width) + "x" + std::to_string(height) + "/" + what).c_str(),
                                 [&bench, width, height, settings](benchmark::State& state) {
                                   run(state, bench, width, height, settings);
                                 })
        ->UseManualTime()
        ->Unit(benchmark::kMillisecond)
        ->MinTime(1.0);
  };
  for (const auto& [width, height] : kSizes) {
    for (const Tier& tier : tiers()) {
      Settings settings;
      settings.tier = tier.name;
      add(width, height, std::string("bright/") + tier.name, settings);
      settings.bloom.threshold = 65504.0f;
      add(width, height, std::string("dim/") + tier.name, settings);
    }
  }
  for (const auto& [what, change] : kVariants) {
    Settings settings;
    change(settings);
    add(1920, 1080, what, settings);
  }
  benchmark::RunSpecifiedBenchmarks();
  benchmark::Shutdown();
  return 0;
}

}  // namespace
}  // namespace candela

int main(int argc, char** argv) { return candela::main_(argc, argv); }
