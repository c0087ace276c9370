#include "tests/bench/workbench.h"

#include <cstring>

#include "server/base/driver_environment.h"

namespace candela::bench {
namespace {

constexpr Variant kVariants[] = {
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

}  // namespace

absl::StatusOr<Workbench> open_workbench() {
  prepare_driver_environment();
  absl::StatusOr<std::unique_ptr<Device>> device = Device::create({});
  if (!device.ok()) return device.status();
  Workbench bench;
  bench.device = *std::move(device);
  bench.pool = std::make_unique<TexturePool>(*bench.device, uint64_t{4} << 30);
  absl::StatusOr<std::unique_ptr<Renderer>> renderer = Renderer::create(*bench.device, *bench.pool);
  if (!renderer.ok()) return renderer.status();
  bench.renderer = *std::move(renderer);
  return bench;
}

void copy_in(const testing::WireFrame& frame, FrameMemory& memory) {
  const uint64_t row_bytes = frame.desc.row_bytes();
  for (uint32_t y = 0; y < frame.desc.height; ++y) {
    std::memcpy(memory.input_row(y).data(), frame.pixels.data() + y * row_bytes, row_bytes);
  }
}

std::span<const Variant> variants() { return kVariants; }

}  // namespace candela::bench
