#include "server/daemon/service_manager.h"

#include <systemd/sd-daemon.h>

#include <cstdint>
#include <utility>

#include "absl/time/time.h"
#include "server/base/log.h"

namespace candela {
namespace {

constexpr int kKeepTheVariables = 0;

}  // namespace

void tell_service_manager(const std::string& lines) {
  if (sd_notify(kKeepTheVariables, lines.c_str()) >= 0) return;
  log_event(LogLevel::kWarning, "cannot notify the service manager", {{"message", lines}});
}

Watchdog::Watchdog(Clock& clock, std::function<bool()> alive) : stop_(clock) {
  uint64_t limit_us = 0;
  if (sd_watchdog_enabled(kKeepTheVariables, &limit_us) <= 0) return;
  const absl::Duration half = absl::Microseconds(limit_us) / 2;
  thread_ = std::thread([this, half, is_alive = std::move(alive)] {
    do {
      if (is_alive()) tell_service_manager("WATCHDOG=1");
    } while (!stop_.comes_within(half));
  });
}

Watchdog::~Watchdog() {
  stop_.give();
  if (thread_.joinable()) thread_.join();
}

}  // namespace candela
