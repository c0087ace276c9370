#include "tests/bench/workbench.h"

#include <cstring>
#include <ctime>

#include "absl/time/time.h"
#include "server/base/process.h"
#include "server/render/settings/tiers.h"
#include "tests/support/clock.h"

namespace candela::bench {
namespace {

void linear(v1::Settings& s) {
  s.set_curve(v1::TONE_CURVE_LINEAR);
  s.set_transfer(v1::TRANSFER_LINEAR);
}

constexpr Variant kVariants[] = {
    {"conserve", [](v1::Settings& s) { s.mutable_bloom()->set_kind(v1::Bloom::KIND_CONSERVE); }},
    {"gaussian",
     [](v1::Settings& s) {
       s.mutable_bloom()->set_kind(v1::Bloom::KIND_GAUSSIAN);
       s.mutable_bloom()->set_threshold(8.0f);
     }},
    {"centre",
     [](v1::Settings& s) {
       s.mutable_exposure()->mutable_metering()->set_weights(v1::Metering::WEIGHTS_CENTER);
     }},
    {"percentile",
     [](v1::Settings& s) {
       s.mutable_exposure()->mutable_metering()->set_statistic(v1::Metering::STATISTIC_PERCENTILE);
     }},
    {"dither", [](v1::Settings& s) { s.set_dither(true); }},
    {"agx", [](v1::Settings& s) { s.set_curve(v1::TONE_CURVE_AGX); }},
    {"aces-1", [](v1::Settings& s) { s.set_curve(v1::TONE_CURVE_ACES_1); }},
    {"aces-2", [](v1::Settings& s) { s.set_curve(v1::TONE_CURVE_ACES_2); }},
    {"pq", [](v1::Settings& s) { s.set_transfer(v1::TRANSFER_PQ); }},
    {"gain-map", [](v1::Settings& s) { s.set_gain_map_peak_nits(1000); }},
    {"pbr-neutral", [](v1::Settings& s) { s.set_curve(v1::TONE_CURVE_PBR_NEUTRAL); }},
    // Frames without curve and transfer, with bloom and without: they show how much the look costs.
    {"linear", linear},
    {"linear-dim",
     [](v1::Settings& s) {
       linear(s);
       s.mutable_bloom()->set_threshold(kNothingBright);
     }},
};

}  // namespace

absl::StatusOr<Workbench> open_workbench(ExecutorKind executor, uint32_t threads) {
  prepare_driver_environment();
  DeviceOptions options;
  options.hang_limit = absl::Hours(1);  // a bake under valgrind takes longer than a device that hangs
  absl::StatusOr<std::unique_ptr<Device>> device = Device::create(options);
  if (!device.ok()) return device.status();
  Workbench bench;
  bench.device = *std::move(device);
  bench.pool = std::make_unique<TexturePool>(*bench.device, uint64_t{4} << 30, testing::real_clock());
  absl::StatusOr<std::unique_ptr<Renderer>> renderer =
      Renderer::create(*bench.device, *bench.pool, executor, threads);
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

testing::WireFrame natural_frame(uint32_t width, uint32_t height, v1::PixelFormat format) {
  return testing::make_frame(width, height, format, testing::ordinary(scenes::natural(width, height)));
}

testing::WireFrame tiles_frame(uint32_t width, uint32_t height) {
  return testing::make_frame(width, height, v1::PIXEL_FORMAT_RGBA16F,
                             testing::ordinary(scenes::lit_tiles(width, height)));
}

absl::StatusOr<Environment> make_environment(EnvironmentBaker& baker, uint32_t width) {
  const testing::WireFrame frame = natural_frame(width, width / 2);
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

std::span<const Variant> variants() { return kVariants; }

double cpu_ms() {
  timespec now{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) * 1e3 + static_cast<double>(now.tv_nsec) * 1e-6;
}

}  // namespace candela::bench
