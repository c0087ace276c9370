// A fixture for the host's passes: frames in the textures of the default device, and the instruction sets.
#pragma once

#include <gtest/gtest.h>

#include <cstring>
#include <functional>
#include <string>
#include <vector>

#include "server/render/device/device_executor.h"
#include "server/render/frame/frame_textures.h"
#include "server/render/host/host_executor.h"
#include "tests/support/device_fixture.h"
#include "tests/support/settings.h"

namespace candela::testing {

inline constexpr v1::PixelFormat kFormats[] = {v1::PIXEL_FORMAT_RGBA16F, v1::PIXEL_FORMAT_RGBA32F,
                                               v1::PIXEL_FORMAT_RGB9E5};

class HostTest : public DeviceTest {
 protected:
  void SetUp() override {
    DeviceTest::SetUp();
    if (const std::string why = HostExecutor::unavailable(device().summary()); !why.empty())
      GTEST_SKIP() << why;
  }

  // The frame's own memory, with NaN in the padding of its rows.
  static FrameMemory in_memory(const WireFrame& frame, const Settings& settings) {
    absl::StatusOr<FrameMemory> memory =
        FrameMemory::take(pool(), device().summary(), layout_textures(frame.desc, settings), Verify::kNo);
    if (!memory.ok()) throw std::runtime_error(memory.status().ToString());
    const Buffer& input = memory->textures().input.buffer();
    std::memset(input.mapped(), 0xff, input.bytes());
    for (uint32_t y = 0; y < frame.desc.height; ++y) {
      std::memcpy(memory->input_row(y).data(), frame.pixels.data() + y * frame.desc.row_bytes(),
                  frame.desc.row_bytes());
    }
    return *std::move(memory);
  }

  // Calls test(name) once for every instruction set that this processor has, while the passes use it.
  static void on_each_instruction_set(const std::function<void(const std::string& name)>& test);
};

// All statistics, the floats by their bits.
void expect_same_stats(const FrameStats& a, const FrameStats& b, const std::string& what);

}  // namespace candela::testing
