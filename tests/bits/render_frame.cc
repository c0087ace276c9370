#include <cmath>
#include <cstring>

#include "server/vulkan/device.h"
#include "tests/bits/bits.h"
#include "tests/support/clock.h"

namespace candela::testing {

namespace {

void add_image(const FrameMemory& memory, Hash& hash) {
  const TextureLayout& layout = memory.textures().layout;
  const auto* exact = memory.textures().exact.buffer().mapped();
  const size_t texel = 4 * sizeof(float);
  for (uint32_t y = 0; y < layout.image.height; ++y) {
    hash.add(memory.output_row(y));
    hash.add(std::span(exact + size_t{y} * layout.image_pitch * texel, layout.image.width * texel));
  }
}

void add_statistics(const FrameStats& stats, Hash& hash) {
  hash.add(stats.mean_log2_luminance);
  hash.add(stats.min_luminance);
  hash.add(stats.max_luminance);
  for (const uint64_t count :
       {stats.nan_components, stats.infinite_components, stats.clamped_components, stats.negative_components,
        stats.negative_scene_components, stats.absent_pixels, stats.metered_weight}) {
    hash.add(count);
  }
  for (const float light : stats.tile_light) hash.add(light);
  for (const float cell : stats.print) hash.add(std::isnan(cell) ? -1000.0f : cell);
  for (const uint64_t weight : stats.histogram) hash.add(weight);
}

}  // namespace

Bench::Bench(uint32_t threads) : pool(*device, uint64_t{1} << 30, real_clock()), executor(*device, threads) {}

FrameMemory Bench::take(const TextureLayout& layout, Verify verify) {
  return FrameMemory::take(pool, device->summary(), layout, verify).value();
}

float steps_of_light(float x) {
  const float whole = std::floor(x);
  return std::ldexp(1 + (x - whole), static_cast<int>(whole));
}

TexelFunction mixed_picture(uint32_t width, uint32_t height) {
  return [=](uint32_t x, uint32_t y) -> Texel {
    if ((x + y) % 11 == 3) return {0, 0, 0, 0};
    const float u = (static_cast<float>(x) + 0.5f) / static_cast<float>(width);
    const float v = (static_cast<float>(y) + 0.5f) / static_cast<float>(height);
    const float light = steps_of_light(14.0f * u - 10.0f) * (0.7f + 0.6f * noise(x, y, 3));
    Texel c = {light * (0.2f + v), light * 0.6f, light * (1.2f - v), 0.25f + 0.5f * v};
    if (noise(x / 5, y / 5, 7) > 0.99f) c = {1000.0f * noise(x / 5, y / 5, 8), 300.0f, 40.0f, 1.0f};
    if (x % 7 == 1) c[1] = -0.25f * c[0];
    return c;
  };
}

void render_frame(Bench& bench, const WireFrame& frame, const v1::Settings& message, uint64_t sequence,
                  std::optional<PreviousExposure>* previous, Bits& bits) {
  const Settings settings = Settings::from(message).value();
  const TextureLayout layout = layout_textures(frame.desc, settings);
  FrameMemory memory = bench.take(layout, Verify::kYes);
  for (uint32_t y = 0; y < frame.desc.height; ++y) {
    std::memcpy(memory.input_row(y).data(), frame.pixels.data() + y * frame.desc.row_bytes(),
                frame.desc.row_bytes());
  }
  const Metered metered = bench.executor.meter(memory, plan_ingest(layout, settings)).value();
  const Exposed exposed = expose(settings->exposure(), *previous, metered.stats.metered_mean());
  const Plan plan = plan_frame(layout, metered, settings,
                               {.exposure = exposed.exposure,
                                .sequence = sequence,
                                .table = color_table_of(settings, metered).value()});
  std::vector<StageTime> stages;
  const Drawn drawn = bench.executor.draw(memory, plan, &stages).value();
  *previous = PreviousExposure{exposed.exposure, 0.04};
  add_image(memory, bits.pixels);
  add_statistics(metered.stats, bits.numbers);
  for (const double factor : {exposed.exposure, exposed.target, exposed.target_before_limits})
    bits.numbers.add(factor);
  bits.numbers.add(drawn.gamut_cut_components);
  bits.numbers.add(drawn.negative_light);
}

Bits render_frame(Bench& bench, const WireFrame& frame, const v1::Settings& settings) {
  Bits bits;
  std::optional<PreviousExposure> previous;
  render_frame(bench, frame, settings, /*sequence=*/5, &previous, bits);
  return bits;
}

}  // namespace candela::testing
