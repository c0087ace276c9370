// A fixture with one device for all device tests of a process.
#pragma once

#include <gtest/gtest.h>

#include <memory>

#include "server/render/renderer.h"
#include "tests/support/clock/real_clock.h"
#include "tests/support/scenes.h"

namespace candela::testing {

// pipeline.md allows 2^-9 of the level's maximum. float32 levels are far better, so this bound is tighter.
inline constexpr double kBloomBound = 4e-6;

// The device, pool and renderers are made once. The passes are those of executor_of_environment().
class DeviceTest : public ::testing::Test {
 protected:
  static void SetUpTestSuite();
  void SetUp() override;
  void TearDown() override;

  static Device& device();
  static TexturePool& pool();
  static Renderer& renderer();
  // On the same device. Made when it is first asked for; 0 threads: as many as CPUs.
  static Renderer& renderer_with(ExecutorKind executor, uint32_t threads = 0);

  struct Rendered {
    FrameMemory memory;
    FrameReport report;
  };
  // Checks the settings, uploads the frame and renders it, on the shared renderer or on another one.
  static absl::StatusOr<Rendered> render(const WireFrame& frame, const v1::Settings& settings,
                                         const FrameMoment& moment = {}, Verify verify = Verify::kNo);
  static absl::StatusOr<Rendered> render_on(Renderer& renderer, const WireFrame& frame,
                                            const v1::Settings& settings, const FrameMoment& moment = {},
                                            Verify verify = Verify::kNo);
  // The finished image without padding.
  static std::vector<std::byte> image(const FrameMemory& memory);

 private:
  uint64_t messages_before_ = 0;
};

}  // namespace candela::testing
