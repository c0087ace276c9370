// Reports this process to systemd, or to any other service manager that listens on $NOTIFY_SOCKET:
// sd_notify(3).
#pragma once

#include <functional>
#include <string>
#include <thread>

#include "server/base/clock.h"

namespace candela {

// Sends lines of VARIABLE=VALUE, such as READY=1. Does nothing if nobody listens.
void tell_service_manager(const std::string& lines);

// Sends the manager a keep-alive, WATCHDOG=1, twice per watchdog period ($WATCHDOG_USEC).
class Watchdog {
 public:
  // Calls `alive` on its own thread and sends nothing while it returns false. Starts no thread if the manager
  // wants no keep-alives. `clock` outlives it.
  Watchdog(Clock& clock, std::function<bool()> alive);
  ~Watchdog();
  Watchdog(const Watchdog&) = delete;
  Watchdog& operator=(const Watchdog&) = delete;

 private:
  StopSign stop_;
  std::thread thread_;
};

}  // namespace candela
