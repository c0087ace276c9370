// Checks whole frames against the float64 reference and the bounds of docs/pipeline.md section 6. Prints a
// line for each.
#pragma once

#include <string>

#include "tests/support/device_fixture.h"

namespace candela::testing {

class FrameErrorTest : public DeviceTest {
 protected:
  static void print_header(const std::string& what);

  // The largest allowed errors in codes. They are close to the measured errors and far below section 6's 0.5
  // and 0.05, so that the tests notice a shader that gets worse.
  struct Bounds {
    double max = 4e-4;
    double p999 = 2.5e-4;
  };

  // Renders and verifies a frame in the settings' own format.
  static void check(const WireFrame& frame, const v1::Settings& settings, const std::string& what,
                    Bounds bounds);
  static void check(const WireFrame& frame, const v1::Settings& settings, const std::string& what) {
    check(frame, settings, what, Bounds());
  }
};

}  // namespace candela::testing
