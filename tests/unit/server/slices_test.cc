// Work that runs in slices of time.
#include "server/base/slices.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <memory>
#include <optional>

#include "absl/time/clock.h"

namespace candela {
namespace {

constexpr absl::Duration kNone = absl::ZeroDuration();

TEST(SlicedWork, PausesAtACheckpointOnceItsSliceIsOverAndGoesOnThere) {
  int step = 0;
  SlicedWork work([&step] {
    for (; step < 3; ++step) checkpoint();
  });
  EXPECT_EQ(step, 0);
  for (int slice = 0; slice < 3; ++slice) {
    EXPECT_FALSE(work.run(kNone));
    EXPECT_EQ(step, slice);
  }
  EXPECT_TRUE(work.run(kNone));
  EXPECT_EQ(step, 3);
}

TEST(SlicedWork, DoesNotPauseWhileItsSliceLasts) {
  int step = 0;
  SlicedWork work([&step] {
    for (; step < 1000; ++step) checkpoint();
  });
  EXPECT_TRUE(work.run(absl::InfiniteDuration()));
  EXPECT_EQ(step, 1000);
}

TEST(SlicedWork, ASliceEndsSoonAfterItsLength) {
  SlicedWork work([] {
    for (const absl::Time end = absl::Now() + absl::Seconds(60); absl::Now() < end;) checkpoint();
  });
  absl::Duration shortest = absl::InfiniteDuration();
  for (int slice = 0; slice < 20; ++slice) {
    const absl::Time begin = absl::Now();
    EXPECT_FALSE(work.run(absl::Milliseconds(20)));
    const absl::Duration took = absl::Now() - begin;
    EXPECT_GE(took, absl::Milliseconds(20));
    shortest = std::min(shortest, took);
  }
  EXPECT_LT(shortest, absl::Milliseconds(40));  // a busy machine may stretch the others
}

TEST(SlicedWork, CancelledWorkReleasesWhatItHolds) {
  const auto held = std::make_shared<int>();
  std::atomic<bool> went_on = false;
  {
    SlicedWork work([copy = held, &went_on] {
      const std::shared_ptr<int> another = copy;
      checkpoint();
      went_on = true;
    });
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
  SlicedWork work([] {
    const Checks checks;
    checkpoint();
  });
  EXPECT_FALSE(work.run(kNone));
}

TEST(SlicedWork, WorkThatNeverBeganIsNotRun) {
  const SlicedWork work([] { ADD_FAILURE(); });
}

TEST(SlicedWork, KnowsTheTimeForWhichItWasPaused) {
  std::chrono::nanoseconds paused{-1};
  SlicedWork work([&paused] {
    checkpoint();
    paused = time_paused();
  });
  EXPECT_FALSE(work.run(kNone));
  absl::SleepFor(absl::Milliseconds(30));
  EXPECT_TRUE(work.run(absl::InfiniteDuration()));
  EXPECT_GE(paused, std::chrono::milliseconds(30));
}

TEST(SlicedWork, OtherThreadsPassEveryCheckpoint) {
  checkpoint();
  EXPECT_EQ(slice_end(), std::chrono::steady_clock::time_point::max());
  EXPECT_EQ(time_paused(), std::chrono::nanoseconds{0});
}

}  // namespace
}  // namespace candela
