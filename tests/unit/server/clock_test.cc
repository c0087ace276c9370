// Virtual time, and what waits by it.
#include "server/base/clock.h"

#include <gtest/gtest.h>

#include <atomic>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "server/base/file_watch.h"
#include "tests/support/clock.h"
#include "tests/support/files.h"

namespace candela {
namespace {

using testing::VirtualClock;

TEST(VirtualClock, AWaitEndsAtItsMomentOrWithItsCondition) {
  VirtualClock clock;
  StopSign sign(clock);
  std::atomic<int> ended = 0;
  std::thread first([&] {
    EXPECT_FALSE(sign.comes_within(absl::Seconds(1)));
    ++ended;
  });
  std::thread second([&] {
    EXPECT_TRUE(sign.comes_within(absl::Hours(1)));
    ++ended;
  });
  clock.wait_for_waiters(2);
  clock.advance(absl::Seconds(1) - absl::Nanoseconds(1));
  EXPECT_EQ(ended, 0);
  clock.advance(absl::Nanoseconds(1));
  first.join();
  EXPECT_EQ(ended, 1);
  sign.give();
  second.join();
  EXPECT_TRUE(sign.comes_within(absl::ZeroDuration()));
}

TEST(VirtualClock, TimersFireInTheirOrderEachAtItsMoment) {
  VirtualClock clock;
  const absl::Time begin = clock.now();
  std::vector<std::pair<char, absl::Duration>> fired;
  const auto note = [&](char name) { return [&, name] { fired.emplace_back(name, clock.now() - begin); }; };
  const std::unique_ptr<Timer> b = clock.call_after(absl::Seconds(2), note('b'));
  std::unique_ptr<Timer> again;
  const std::unique_ptr<Timer> a = clock.call_after(absl::Seconds(1), [&] {
    note('a')();
    again = clock.call_after(absl::Seconds(1), note('c'));
  });
  std::unique_ptr<Timer> gone = clock.call_after(absl::Seconds(1), note('x'));
  gone.reset();
  clock.advance(absl::Seconds(5));
  EXPECT_EQ(fired, (std::vector<std::pair<char, absl::Duration>>{
                       {'a', absl::Seconds(1)}, {'b', absl::Seconds(2)}, {'c', absl::Seconds(2)}}));
  EXPECT_EQ(clock.now() - begin, absl::Seconds(5));
}

TEST(RealClock, WaitsAndSleeps) {
  Clock& clock = testing::real_clock();
  const absl::Time begin = clock.now();
  clock.sleep(absl::Milliseconds(5));
  StopSign sign(clock);
  EXPECT_FALSE(sign.comes_within(absl::Milliseconds(5)));
  sign.give();
  EXPECT_TRUE(sign.comes_within(absl::Hours(1)));
  EXPECT_GE(clock.now() - begin, absl::Milliseconds(10));
}

TEST(OneASecond, LetsOnePassAndCountsTheOthers) {
  VirtualClock clock;
  OneASecond limit;
  EXPECT_EQ(limit.pass(clock.now()), 1u);
  for (int i = 0; i < 9; ++i) {
    EXPECT_EQ(limit.pass(clock.now()), std::nullopt);
    clock.advance(absl::Milliseconds(100));
  }
  clock.advance(absl::Milliseconds(100));
  EXPECT_EQ(limit.pass(clock.now()), 10u);
  EXPECT_EQ(limit.pass(clock.now()), std::nullopt);
}

TEST(FileWatch, TellsAChangeWhenALookFindsNoFurtherOne) {
  const TemporaryFolder folder;
  const std::string path = folder.path("watched");
  const auto write = [&](const std::string& text) { write_file(path, text); };
  write("a");
  VirtualClock clock;
  std::atomic<int> changes = 0;
  const FileWatch watch({path}, clock, [&] { ++changes; });
  clock.wait_for_waiters(1);
  EXPECT_EQ(changes, 1) << "once at the start";
  clock.tick(absl::Seconds(1), 5);
  EXPECT_EQ(changes, 1);
  write("bb");
  clock.tick(absl::Seconds(1));
  write("ccc");
  clock.tick(absl::Seconds(1));
  EXPECT_EQ(changes, 1) << "it still moves";
  clock.tick(absl::Seconds(1));
  EXPECT_EQ(changes, 2);
}

}  // namespace
}  // namespace candela
