#include "server/schedule/heartbeat.h"

#include <gtest/gtest.h>

#include <atomic>
#include <thread>
#include <vector>

#include "absl/synchronization/blocking_counter.h"
#include "absl/synchronization/mutex.h"
#include "absl/synchronization/notification.h"
#include "absl/time/clock.h"
#include "tests/support/clock.h"
#include "tests/support/status.h"

namespace candela {
namespace {

using testing::real_clock;
using testing::VirtualClock;

constexpr Heartbeat::Options kHeartbeatOptions;
const absl::Duration kTick = kHeartbeatOptions.interval / 4;

// Keeps the reports.
class Reports {
 public:
  std::function<void(Heartbeat::Pulse)> function() {
    return [this](Heartbeat::Pulse pulse) {
      absl::MutexLock lock(&mutex_);
      all_.push_back(pulse);
    };
  }
  std::vector<Heartbeat::Pulse> all() const {
    absl::MutexLock lock(&mutex_);
    return all_;
  }

 private:
  mutable absl::Mutex mutex_;
  std::vector<Heartbeat::Pulse> all_;
};

RenderLoop idle_loop(Clock& clock) {
  return RenderLoop([](const FrameJob&) { return FrameReport{}; }, 8, clock);
}

// Waits until the loop has done the beats that it was asked for.
void settle(RenderLoop& loop) {
  absl::Notification done;
  ASSERT_TRUE(loop.post([&done] { done.Notify(); }).ok());
  done.WaitForNotification();
}

// Lets time pass for a loop that is not stuck.
void pass(VirtualClock& clock, RenderLoop& loop, int ticks) {
  for (int i = 0; i < ticks; ++i) {
    clock.tick(kTick);
    settle(loop);
  }
}

constexpr int kLimitTicks = 24;        // of kHeartbeatOptions.limit
constexpr int kMovingLimitTicks = 96;  // of kHeartbeatOptions.moving_limit

TEST(Heartbeat, AnIdleLoopIsAskedOnceAnIntervalAndStaysGood) {
  VirtualClock clock;
  RenderLoop loop = idle_loop(clock);
  Reports reports;
  std::atomic<int> beats = 0;
  Heartbeat heartbeat(
      loop, clock,
      [&beats] {
        ++beats;
        return absl::OkStatus();
      },
      kHeartbeatOptions, reports.function());
  pass(clock, loop, 400);
  EXPECT_EQ(beats, 100);
  heartbeat.stop();
  EXPECT_TRUE(reports.all().empty());
}

TEST(Heartbeat, GoodFramesSpareTheBeat) {
  VirtualClock clock;
  RenderLoop loop = idle_loop(clock);
  Reports reports;
  std::atomic<int> beats = 0;
  Heartbeat heartbeat(
      loop, clock,
      [&beats] {
        ++beats;
        return absl::OkStatus();
      },
      kHeartbeatOptions, reports.function());
  for (int i = 0; i < 100; ++i) {
    heartbeat.worked(true);
    pass(clock, loop, 3);
  }
  EXPECT_EQ(beats, 0);
}

TEST(Heartbeat, BeatsThatFailAreReportedAndSoIsThatTheyWorkAgain) {
  VirtualClock clock;
  RenderLoop loop = idle_loop(clock);
  Reports reports;
  std::atomic<bool> good = false;
  Heartbeat heartbeat(
      loop, clock, [&good] { return good ? absl::OkStatus() : absl::UnavailableError("lost"); },
      kHeartbeatOptions, reports.function());
  pass(clock, loop, kLimitTicks);
  EXPECT_TRUE(reports.all().empty());
  pass(clock, loop, 1);
  const Heartbeat::Pulse bad{.working = false, .moving = true};
  EXPECT_EQ(reports.all(), std::vector{bad});
  pass(clock, loop, kMovingLimitTicks);
  EXPECT_EQ(reports.all(), std::vector{bad}) << "beats that fail end, too";
  good = true;
  pass(clock, loop, 2);
  EXPECT_EQ(reports.all(), (std::vector{bad, Heartbeat::Pulse{}}));
}

// Frames that fail because of a client only show that the thread moves.
TEST(Heartbeat, FramesThatFailDoNotHideThatBeatsDo) {
  VirtualClock clock;
  RenderLoop loop = idle_loop(clock);
  Reports reports;
  Heartbeat heartbeat(
      loop, clock, [] { return absl::UnavailableError("lost"); }, kHeartbeatOptions, reports.function());
  for (int i = 0; i <= kLimitTicks; ++i) {
    heartbeat.worked(false);
    pass(clock, loop, 1);
  }
  EXPECT_EQ(reports.all(), (std::vector<Heartbeat::Pulse>{{.working = false, .moving = true}}));
}

TEST(Heartbeat, AThreadThatIsStuckIsReportedAndSoIsItsEnd) {
  VirtualClock clock;
  absl::Notification open;
  RenderLoop loop(
      [&open](const FrameJob&) {
        open.WaitForNotification();
        return FrameReport{};
      },
      8, clock);
  Reports reports;
  Heartbeat heartbeat(
      loop, clock, [] { return absl::OkStatus(); }, kHeartbeatOptions, reports.function());
  FrameJob job;
  job.frame = std::make_shared<Frame>();
  job.done = [](auto) {};
  ASSERT_OK(loop.submit(std::move(job)));
  while (loop.waiting() > 0) std::this_thread::yield();  // it has begun
  clock.tick(kTick, kLimitTicks);
  EXPECT_TRUE(reports.all().empty());
  clock.tick(kTick, kMovingLimitTicks - kLimitTicks);
  const Heartbeat::Pulse slow{.working = false, .moving = true};
  EXPECT_EQ(reports.all(), std::vector{slow});
  clock.tick(kTick);
  const Heartbeat::Pulse stuck{.working = false, .moving = false};
  EXPECT_EQ(reports.all(), (std::vector{slow, stuck}));
  open.Notify();
  settle(loop);
  clock.tick(kTick);
  EXPECT_EQ(reports.all(), (std::vector{slow, stuck, Heartbeat::Pulse{}}));
}

TEST(Heartbeat, ABeatThatWaitsWhenItStopsIsNotSent) {
  VirtualClock clock;
  absl::Notification open;
  std::atomic<int> beats = 0;
  RenderLoop loop(
      [&open](const FrameJob&) {
        open.WaitForNotification();
        return FrameReport{};
      },
      8, clock);
  FrameJob job;
  job.frame = std::make_shared<Frame>();
  job.done = [](auto) {};
  ASSERT_OK(loop.submit(std::move(job)));
  while (loop.waiting() > 0) std::this_thread::yield();
  {
    Heartbeat heartbeat(
        loop, clock,
        [&beats] {
          ++beats;
          return absl::OkStatus();
        },
        kHeartbeatOptions, [](Heartbeat::Pulse) {});
    clock.tick(kTick, 8);
  }
  open.Notify();
  loop.stop();
  EXPECT_EQ(beats, 0);
}

TEST(Heartbeat, BeatsInRealTimeToo) {
  RenderLoop loop = idle_loop(real_clock());
  absl::BlockingCounter beats(3);
  std::atomic<int> sent = 0;
  const Heartbeat heartbeat(
      loop, real_clock(),
      [&] {
        if (++sent <= 3) beats.DecrementCount();
        return absl::OkStatus();
      },
      {.interval = absl::Milliseconds(20)}, [](Heartbeat::Pulse) {});
  beats.Wait();
}

}  // namespace
}  // namespace candela
