// Helpers for tests that use a Vulkan driver: how long it is kept, and when its devices are closed.
#pragma once

#include <gtest/gtest.h>

#include <memory>

#include "server/render/executor_kind.h"
#include "server/render/renderer.h"
#include "tests/support/clock.h"
#include "tests/support/scenes.h"

namespace candela::testing {

// Calls `close` after the last test of the process. Devices that tests share are destroyed there: at the
// process's exit, some drivers and the validation layers are gone before the statics are.
class CloseAfterTests : public ::testing::Environment {
 public:
  explicit CloseAfterTests(void (*close)()) : close_(close) {}
  void TearDown() override { close_(); }

 private:
  void (*const close_)();
};

// Keeps a Vulkan instance for the rest of the process, for the leak sanitizer. The software driver is
// unloaded with the last instance and leaks a little then.
void keep_driver_loaded();

// Who makes the passes in the tests.

// The passes that the variable CANDELA_TEST_EXECUTOR names, device or host. Without it, auto.
ExecutorKind executor_of_environment();

// A fixture with one device for all device tests of a process.

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
