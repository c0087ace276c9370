// Whole frames against the float64 reference, held to docs/pipeline.md section 6, a line printed for each.
#pragma once

#include <string>

#include "tests/support/device_fixture.h"

namespace candela::testing {

class FrameErrorTest : public DeviceTest {
 protected:
  static void print_header(const std::string& what);

  // Renders in RGBA16 to measure codes and in RGBA8 to count components.
  static void check(const WireFrame& frame, Settings settings, const std::string& what);
};

}  // namespace candela::testing
