#include "server/render/tier_times.h"

#include <half.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>

#include "server/base/slices.h"
#include "server/base/status_macros.h"
#include "server/render/self_test.h"
#include "server/render/settings/tiers.h"
#include "shaders/pcg_hash.h"

namespace candela {

namespace {

constexpr int kTimedFrames = 5;
// Large enough for a time per pixel, and small enough that a frame takes far less than a slice of the render
// thread; the reference takes a hundred times as long. Small first.
struct Size {
  uint32_t width;
  uint32_t height;
};
using Sizes = std::array<Size, 2>;
constexpr Sizes kDeviceSizes = {{{128, 128}, {1024, 512}}};
constexpr Sizes kHostSizes = {{{32, 32}, {128, 64}}};
const Sizes& sizes_of(const Tier& tier) { return tier.host_reference ? kHostSizes : kDeviceSizes; }

// A ramp from 2^-9 to 2^5 with noise, and lights up to 1000 on a hundredth of it, in kUsualFormat.
void fill(const FrameDesc& desc, uint32_t y, std::byte* out) {
  for (uint32_t x = 0; x < desc.width; ++x, out += bytes_per_pixel(kUsualFormat)) {
    const uint32_t noise = pcg_hash(x + 16411u * y), block = pcg_hash(x / 5 + 32771u * (y / 5));
    const bool light = block % 100 == 0;
    const int exponent = light ? 1 : static_cast<int>(14 * x / desc.width) - 18;
    const uint32_t mantissas[] = {128 + noise % 384, 128 + (noise >> 9) % 384,
                                  light ? block >> 23 : 128 + (noise >> 18) % 384};
    uint16_t halves[4] = {0, 0, 0, imath_float_to_half(1)};
    for (int i = 0; i < 3; ++i) {
      halves[i] = imath_float_to_half(std::ldexp(static_cast<float>(mantissas[i]), exponent));
    }
    std::memcpy(out, halves, sizeof halves);
  }
}

absl::StatusOr<FrameMemory> picture(Renderer& renderer, const FrameDesc& desc, const Settings& settings) {
  absl::StatusOr<FrameMemory> memory = renderer.allocate(desc, settings);
  if (!memory.ok()) return memory;
  for (uint32_t y = 0; y < desc.height; ++y) fill(desc, y, memory->input_row(y).data());
  return memory;
}

double device_ms(const FrameReport& report) {
  uint64_t ns = 0;
  for (const StageTime& stage : report.stages) ns += stage.ns;
  return static_cast<double>(ns) * 1e-6;
}

// The median time of a frame of this size.
absl::StatusOr<double> measure_frame(Renderer& renderer, const FrameDesc& desc, const Settings& settings) {
  checkpoint();
  ASSIGN_OR_RETURN(FrameMemory memory, picture(renderer, desc, settings));
  std::vector<double> times;
  for (int i = 0; i <= kTimedFrames; ++i) {
    checkpoint();
    ASSIGN_OR_RETURN(const FrameReport report, renderer.render(memory, settings));
    if (i > 0) times.push_back(device_ms(report));  // the first one compiles
  }
  std::nth_element(times.begin(), times.begin() + kTimedFrames / 2, times.end());
  return times[kTimedFrames / 2];
}

}  // namespace

absl::StatusOr<TierTimes> measure_tiers(Renderer& renderer) {
  TierTimes times;
  for (const Tier& tier : tiers()) {
    std::vector<MeasuredTime>& of_tier = times.emplace_back();
    for (const Size& size : sizes_of(tier)) {
      ASSIGN_OR_RETURN(const double ms, measure_frame(renderer, {size.width, size.height, kUsualFormat},
                                                      Settings().with_tier(tier.name)));
      of_tier.push_back({size.width, size.height, ms});
    }
  }
  return times;
}

}  // namespace candela
