// Keeps a server's device busy, for tests of frames that wait for their turn.
#pragma once

#include <gtest/gtest.h>

#include <atomic>
#include <thread>

#include "absl/synchronization/notification.h"
#include "absl/time/clock.h"
#include "tests/service/service_fixture.h"

namespace candela::testing {

// Keeps the server's render thread busy for about a second with a frame that is compared with the reference.
class BusyDevice {
 public:
  // Returns once the thread is busy.
  explicit BusyDevice(const Connection& connection)
      : thread_([this, connection] {
          FrameView frame = view(frame_);
          frame.verify = true;
          frame.on_sent = [this] { sent_.Notify(); };
          const absl::StatusOr<RenderResult> result = connection.render({}, frame);
          EXPECT_TRUE(result.ok()) << result.status();
          busy_ = false;
        }) {
    sent_.WaitForNotification();
    absl::SleepFor(absl::Milliseconds(50));
  }
  ~BusyDevice() { wait(); }

  bool busy() const { return busy_; }
  void wait() {
    if (thread_.joinable()) thread_.join();
  }

 private:
  const WireFrame frame_ = natural(960, 540);
  absl::Notification sent_;
  std::atomic<bool> busy_ = true;
  std::thread thread_;  // last: it uses the rest
};

}  // namespace candela::testing
