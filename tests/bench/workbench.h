// A renderer on the default device, and the settings that the benchmarks compare.
#pragma once

#include <memory>
#include <span>

#include "absl/status/statusor.h"
#include "server/render/environment/environment_baker.h"
#include "server/render/renderer.h"
#include "tests/support/scenes.h"

namespace candela::bench {

// Destroyed in the reverse order.
struct Workbench {
  std::unique_ptr<Device> device;
  std::unique_ptr<TexturePool> pool;
  std::unique_ptr<Renderer> renderer;
};

// Also prepares the driver's environment, so call it before other threads read that. `threads`: of the host's
// passes; 0: as many as CPUs.
absl::StatusOr<Workbench> open_workbench(ExecutorKind executor, uint32_t threads = 0);

// Copies the frame's pixels into the renderer's memory.
void copy_in(const testing::WireFrame& frame, FrameMemory& memory);

// scenes::natural() and scenes::lit_tiles() as most frames are: without alpha and without negative
// components.
testing::WireFrame natural_frame(uint32_t width, uint32_t height,
                                 v1::PixelFormat format = v1::PIXEL_FORMAT_RGBA16F);
testing::WireFrame tiles_frame(uint32_t width, uint32_t height);

// A panorama that is half as high as wide, with what its views read.
absl::StatusOr<Environment> make_environment(EnvironmentBaker& baker, uint32_t width);

// A threshold that is higher than any luminance in natural_frame(), so that nothing blooms.
inline constexpr float kNothingBright = 65504.0f;
// A threshold that only the lights of tiles_frame() exceed.
inline constexpr float kLightsOnly = 8192.0f;

// A setting that differs from its default.
struct Variant {
  const char* name;
  void (*change)(v1::Settings&);
};
std::span<const Variant> variants();

// Processor time of the whole process. It depends less on other programs' load than elapsed time does.
double cpu_ms();

}  // namespace candela::bench
