// Keeps a server's device busy, for tests of frames that wait for their turn.
#pragma once

#include <gtest/gtest.h>

#include "absl/synchronization/notification.h"
#include "absl/time/clock.h"
#include "server/server.h"

namespace candela::testing {

// The server renders nothing from construction until release() or destruction.
class BusyDevice {
 public:
  explicit BusyDevice(Server& server) : server_(server) {
    const absl::Status occupied = server.occupy_device([this] {
      busy_.Notify();
      released_.WaitForNotification();
      left_.Notify();
    });
    EXPECT_TRUE(occupied.ok()) << occupied;
    busy_.WaitForNotification();
  }
  ~BusyDevice() { release(); }

  // Returns false if fewer frames than this wait after a minute.
  bool wait_until_waiting(size_t frames) const {
    const absl::Time until = absl::Now() + absl::Minutes(1);
    while (server_.frames_waiting() < frames && absl::Now() < until) absl::SleepFor(absl::Milliseconds(5));
    return server_.frames_waiting() >= frames;
  }

  void release() {
    if (!released_.HasBeenNotified()) released_.Notify();
    left_.WaitForNotification();
  }

 private:
  const Server& server_;
  absl::Notification busy_, released_, left_;
};

}  // namespace candela::testing
