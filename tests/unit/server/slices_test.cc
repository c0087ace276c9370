// Work that runs in slices of time.
#include "server/base/slices.h"

#include <gtest/gtest.h>

#include <atomic>
#include <memory>
#include <optional>

#include "absl/time/clock.h"
#include "tests/support/clock.h"

namespace candela {
namespace {

using testing::real_clock;
using testing::VirtualClock;

constexpr absl::Duration kNone = absl::ZeroDuration();

TEST(SlicedWork, PausesAtACheckpointOnceItsSliceIsOverAndGoesOnThere) {
  VirtualClock clock;
  int step = 0;
  SlicedWork work(
      [&step] {
        for (; step < 3; ++step) checkpoint();
      },
      clock);
  EXPECT_EQ(step, 0);
  for (int slice = 0; slice < 3; ++slice) {
    EXPECT_FALSE(work.run(kNone));
    EXPECT_EQ(step, slice);
  }
  EXPECT_TRUE(work.run(kNone));
  EXPECT_EQ(step, 3);
}

TEST(SlicedWork, DoesNotPauseWhileItsSliceLasts) {
  VirtualClock clock;
  int step = 0;
  SlicedWork work(
      [&step] {
        for (; step < 1000; ++step) checkpoint();
      },
      clock);
  EXPECT_TRUE(work.run(absl::InfiniteDuration()));
  EXPECT_EQ(step, 1000);
}

TEST(SlicedWork, ASliceEndsAtTheFirstCheckpointAfterItsLength) {
  VirtualClock clock;
  int steps = 0;
  SlicedWork work(
      [&] {
        for (;; ++steps, clock.advance(absl::Milliseconds(3))) checkpoint();
      },
      clock);
  for (int slice = 1; slice <= 20; ++slice) {
    EXPECT_FALSE(work.run(absl::Milliseconds(20)));
    EXPECT_EQ(steps, 7 * slice);
  }
}

TEST(SlicedWork, ASliceOfRealTimeEndsToo) {
  SlicedWork work(
      [] {
        for (;;) checkpoint();
      },
      real_clock());
  const absl::Time begin = absl::Now();
  EXPECT_FALSE(work.run(absl::Milliseconds(20)));
  EXPECT_GE(absl::Now() - begin, absl::Milliseconds(20));
}

TEST(SlicedWork, CancelledWorkReleasesWhatItHolds) {
  VirtualClock clock;
  const auto held = std::make_shared<int>();
  std::atomic<bool> went_on = false;
  {
    SlicedWork work(
        [copy = held, &went_on] {
          const std::shared_ptr<int> another = copy;
          checkpoint();
          went_on = true;
        },
        clock);
    EXPECT_FALSE(work.run(kNone));
    EXPECT_EQ(held.use_count(), 3);
  }
  EXPECT_EQ(held.use_count(), 1);
  EXPECT_FALSE(went_on);
}

// A destructor that comes to a checkpoint while the work unwinds must not throw, and nobody would resume it.
TEST(SlicedWork, CancelledWorkDoesNotPauseAgain) {
  struct Checks {
    ~Checks() { checkpoint(); }
  };
  VirtualClock clock;
  SlicedWork work(
      [] {
        const Checks checks;
        checkpoint();
      },
      clock);
  EXPECT_FALSE(work.run(kNone));
}

TEST(SlicedWork, WorkThatNeverBeganIsNotRun) {
  VirtualClock clock;
  const SlicedWork work([] { ADD_FAILURE(); }, clock);
}

TEST(SlicedWork, KnowsTheTimeForWhichItWasPaused) {
  VirtualClock clock;
  std::chrono::nanoseconds paused{-1};
  SlicedWork work(
      [&paused] {
        checkpoint();
        paused = time_paused();
      },
      clock);
  EXPECT_FALSE(work.run(kNone));
  clock.advance(absl::Milliseconds(30));
  EXPECT_TRUE(work.run(absl::InfiniteDuration()));
  EXPECT_EQ(paused, std::chrono::milliseconds(30));
}

TEST(SlicedWork, OtherThreadsPassEveryCheckpoint) {
  checkpoint();
  EXPECT_EQ(slice_end(), std::chrono::steady_clock::time_point::max());
  EXPECT_EQ(time_paused(), std::chrono::nanoseconds{0});
}

}  // namespace
}  // namespace candela
