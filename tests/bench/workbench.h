// What the benchmarks share: a renderer on the default device, and the settings worth a row.
#pragma once

#include <memory>
#include <span>

#include "absl/status/statusor.h"
#include "server/render/renderer.h"
#include "tests/support/scenes.h"

namespace candela::bench {

// Destroyed in the reverse order.
struct Workbench {
  std::unique_ptr<Device> device;
  std::unique_ptr<TexturePool> pool;
  std::unique_ptr<Renderer> renderer;
};

// Prepares the driver's environment, too: before other threads read it.
absl::StatusOr<Workbench> open_workbench();

// Copies the frame's pixels to where the renderer reads them.
void copy_in(const testing::WireFrame& frame, FrameMemory& memory);

// Scene luminance above which testing::natural() has no light, so that nothing blooms.
inline constexpr float kNothingBright = 65504.0f;
// Above all of testing::lit_tiles() but its lights.
inline constexpr float kLightsOnly = 8192.0f;

// One setting that differs from the default ones.
struct Variant {
  const char* name;
  void (*change)(v1::Settings&);
};
std::span<const Variant> variants();

}  // namespace candela::bench
