// Timers that fire on gRPC's threads.
#pragma once

#include "server/base/clock.h"

namespace candela {

class AlarmTimers final : public Timers {
 public:
  std::unique_ptr<Timer> call_after(absl::Duration wait, std::function<void()> then) override;
};

}  // namespace candela
