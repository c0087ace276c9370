#include "server/schedule/heartbeat.h"

#include <gtest/gtest.h>

#include <atomic>
#include <vector>

#include "absl/synchronization/mutex.h"
#include "absl/synchronization/notification.h"
#include "absl/time/clock.h"
#include "tests/support/status.h"

namespace candela {
namespace {

constexpr Heartbeat::Options kFast = {.interval = absl::Milliseconds(20),
                                      .limit = absl::Milliseconds(100),
                                      .moving_limit = absl::Milliseconds(400)};

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
  // Returns false after 10 s.
  bool wait_for(Heartbeat::Pulse pulse) const {
    absl::MutexLock lock(&mutex_);
    const auto last = [&] { return !all_.empty() && all_.back() == pulse; };
    return mutex_.AwaitWithTimeout(absl::Condition(&last), absl::Seconds(10));
  }

 private:
  mutable absl::Mutex mutex_;
  std::vector<Heartbeat::Pulse> all_;
};

RenderLoop idle_loop() {
  return RenderLoop([](const FrameJob&) { return FrameReport{}; }, 8);
}

TEST(Heartbeat, AnIdleLoopIsAskedAgainAndAgainAndStaysGood) {
  RenderLoop loop = idle_loop();
  Reports reports;
  std::atomic<int> beats = 0;
  Heartbeat heartbeat(
      loop,
      [&beats] {
        ++beats;
        return absl::OkStatus();
      },
      kFast, reports.function());
  for (const absl::Time limit = absl::Now() + absl::Seconds(10); beats < 5 && absl::Now() < limit;) {
    absl::SleepFor(absl::Milliseconds(5));
  }
  EXPECT_GE(beats, 5);
  heartbeat.stop();
  EXPECT_TRUE(reports.all().empty());
}

TEST(Heartbeat, GoodFramesSpareTheBeat) {
  RenderLoop loop = idle_loop();
  Reports reports;
  std::atomic<int> beats = 0;
  Heartbeat::Options slow = kFast;
  slow.interval = absl::Milliseconds(200);
  slow.limit = absl::Seconds(2);
  Heartbeat heartbeat(
      loop,
      [&beats] {
        ++beats;
        return absl::OkStatus();
      },
      slow, reports.function());
  for (int i = 0; i < 100; ++i) {
    heartbeat.worked(true);
    absl::SleepFor(absl::Milliseconds(5));
  }
  EXPECT_EQ(beats, 0);
}

TEST(Heartbeat, BeatsThatFailAreReportedAndSoIsThatTheyWorkAgain) {
  RenderLoop loop = idle_loop();
  Reports reports;
  std::atomic<bool> good = false;
  Heartbeat heartbeat(
      loop, [&good] { return good ? absl::OkStatus() : absl::UnavailableError("lost"); }, kFast,
      reports.function());
  EXPECT_TRUE(reports.wait_for({.working = false, .moving = true}));
  good = true;
  EXPECT_TRUE(reports.wait_for({.working = true, .moving = true}));
  EXPECT_EQ(reports.all().size(), 2u);
}

// Frames that fail because of a client only show that the thread moves.
TEST(Heartbeat, FramesThatFailDoNotHideThatBeatsDo) {
  RenderLoop loop = idle_loop();
  Reports reports;
  Heartbeat heartbeat(
      loop, [] { return absl::UnavailableError("lost"); }, kFast, reports.function());
  for (const absl::Time limit = absl::Now() + absl::Seconds(1); absl::Now() < limit;) {
    heartbeat.worked(false);
    absl::SleepFor(absl::Milliseconds(5));
  }
  EXPECT_TRUE(reports.wait_for({.working = false, .moving = true}));
}

TEST(Heartbeat, AThreadThatIsStuckIsReportedAndSoIsItsEnd) {
  absl::Notification open;
  RenderLoop loop(
      [&open](const FrameJob&) {
        open.WaitForNotification();
        return FrameReport{};
      },
      8);
  Reports reports;
  Heartbeat heartbeat(
      loop, [] { return absl::OkStatus(); }, kFast, reports.function());
  FrameJob job;
  job.frame = std::make_shared<Frame>();
  job.done = [](auto) {};
  ASSERT_OK(loop.submit(std::move(job)));
  EXPECT_TRUE(reports.wait_for({.working = false, .moving = true}));
  EXPECT_TRUE(reports.wait_for({.working = false, .moving = false}));
  open.Notify();
  EXPECT_TRUE(reports.wait_for({.working = true, .moving = true}));
}

TEST(Heartbeat, ABeatThatWaitsWhenItStopsIsNotSent) {
  absl::Notification open;
  std::atomic<int> beats = 0;
  RenderLoop loop(
      [&open](const FrameJob&) {
        open.WaitForNotification();
        return FrameReport{};
      },
      8);
  FrameJob job;
  job.frame = std::make_shared<Frame>();
  job.done = [](auto) {};
  ASSERT_OK(loop.submit(std::move(job)));
  {
    Heartbeat heartbeat(
        loop,
        [&beats] {
          ++beats;
          return absl::OkStatus();
        },
        kFast, [](Heartbeat::Pulse) {});
    absl::SleepFor(absl::Milliseconds(100));
  }
  open.Notify();
  loop.stop();
  EXPECT_EQ(beats, 0);
}

}  // namespace
}  // namespace candela
