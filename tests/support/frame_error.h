// Whole frames against the float64 reference, held to docs/pipeline.md section 6, a line printed for each.
#pragma once

#include <string>

#include "tests/support/device_fixture.h"

namespace candela::testing {

class FrameErrorTest : public DeviceTest {
 protected:
  static void print_header(const std::string& what);

  // In codes. What the pipeline reaches, far inside section 6's 0.5 and 0.05, so that a worse shader is
  // noticed.
  struct Bounds {
    double max = 4e-4;
    double p999 = 2.5e-4;
  };

  // Renders and verifies it, in the settings' own format.
  static void check(const WireFrame& frame, const Settings& settings, const std::string& what, Bounds bounds);
  static void check(const WireFrame& frame, const Settings& settings, const std::string& what) {
    check(frame, settings, what, Bounds());
  }
};

}  // namespace candela::testing
