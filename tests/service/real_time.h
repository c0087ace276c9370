// What a server in a test runs on, unless time matters to the test.
#pragma once

#include "server/alarm_timers.h"
#include "tests/support/clock.h"

namespace candela::testing {

inline AlarmTimers& alarm_timers() {
  static AlarmTimers timers;
  return timers;
}

}  // namespace candela::testing
