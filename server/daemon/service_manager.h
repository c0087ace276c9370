// What systemd, or whoever else listens on $NOTIFY_SOCKET, is told about this process: sd_notify(3).
#pragma once

#include <functional>
#include <string>
#include <thread>

#include "absl/synchronization/notification.h"

namespace candela {

// Lines of VARIABLE=VALUE, such as READY=1. Nothing happens where nobody listens.
void tell_service_manager(const std::string& lines);

// Gives the manager a sign of life, WATCHDOG=1, after each half of the time in which it wants one
// ($WATCHDOG_USEC).
class Watchdog {
 public:
  // No sign is given while `alive`, called on a thread of the watchdog's own, says that there is no life.
  // Nothing is started where no signs are wanted.
  explicit Watchdog(std::function<bool()> alive);
  ~Watchdog();
  Watchdog(const Watchdog&) = delete;
  Watchdog& operator=(const Watchdog&) = delete;

 private:
  absl::Notification stop_;
  std::thread thread_;
};

}  // namespace candela
