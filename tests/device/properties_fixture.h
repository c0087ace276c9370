// The fixture of the tests of properties that hold for every frame.
#pragma once

#include <stdexcept>

#include "tests/support/device_fixture.h"

namespace candela::testing {

class Properties : public DeviceTest {
 protected:
  // Throws if it cannot render, which fails only this test.
  static Rendered must_render(const WireFrame& frame, const v1::Settings& settings = {}) {
    auto rendered = render(frame, settings);
    if (!rendered.ok()) throw std::runtime_error(rendered.status().ToString());
    return *std::move(rendered);
  }
};

}  // namespace candela::testing
