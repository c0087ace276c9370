// The machine's clock, for tests that take real time.
#pragma once

#include "server/base/clock.h"

namespace candela::testing {

inline RealClock& real_clock() {
  static RealClock clock;
  return clock;
}

}  // namespace candela::testing
