// The time, the chance and the log of one history.
#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <utility>

#include "absl/strings/str_format.h"
#include "server/base/clock.h"
#include "tests/support/simulated/chance.h"

namespace candela::testing {

// One thread runs everything: the events of a history, in the order of their moments. Nothing in it waits.
class World final : public Clock, public Timers {
 public:
  // `log`: every note() is printed.
  World(uint64_t seed, bool log) : chance(seed), log_(log) {}

  Chance chance;

  absl::Time now() override { return kBegin + passed_; }
  std::chrono::steady_clock::time_point steady() override;
  bool await(absl::Mutex& mutex, const absl::Condition& condition, absl::Duration timeout) override
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex);
  std::unique_ptr<Timer> call_after(absl::Duration wait, std::function<void()> then) override;

  // An event that comes for certain.
  void after(absl::Duration wait, std::function<void()> then);
  // Goes on to the next event and runs it. False: there is none.
  bool step();
  // No event that is left will come.
  void end();
  absl::Duration passed() const { return passed_; }

  template <typename... Args>
  void note(const std::string& who, const absl::FormatSpec<Args...>& format, const Args&... args) {
    if (log_) print(who, absl::StrFormat(format, args...));
  }

 private:
  // By their moments, and those of one moment in the order in which they were made.
  using Moment = std::pair<absl::Duration, uint64_t>;
  class Alarm;
  static constexpr absl::Time kBegin = absl::FromUnixSeconds(1'600'000'000);

  Moment add(absl::Duration wait, std::function<void()> then);
  void print(const std::string& who, const std::string& what) const;

  const bool log_;
  absl::Duration passed_;
  uint64_t made_ = 0;
  std::map<Moment, std::function<void()>> events_;
};

// A clock whose date is wrong, and goes wrong. It measures time as the world does.
class WrongClock final : public Clock {
 public:
  // `drift`: how much too fast it goes, 0 for not at all.
  WrongClock(World& world, absl::Duration offset, double drift)
      : world_(world), offset_(offset), drift_(drift) {}

  absl::Time now() override { return world_.now() + offset_ + world_.passed() * drift_; }
  std::chrono::steady_clock::time_point steady() override { return world_.steady(); }
  bool await(absl::Mutex& mutex, const absl::Condition& condition, absl::Duration timeout) override
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex) {
    return world_.await(mutex, condition, timeout);
  }
  void set(absl::Duration by) { offset_ += by; }

 private:
  World& world_;
  absl::Duration offset_;
  const double drift_;
};

// A process that can be stopped and go on again, as by SIGSTOP and SIGCONT.
class Process {
 public:
  Process(World& world, std::string name) : world_(world), name_(std::move(name)) {}
  virtual ~Process() = default;

  // The event happens in the process: now, or when it goes on.
  void tell(std::function<void()> event);
  void stop();
  void go_on();
  bool stopped() const { return stopped_; }
  World& world() { return world_; }
  const std::string& name() const { return name_; }

 protected:
  // After every event.
  virtual void react() = 0;

 private:
  World& world_;
  const std::string name_;
  bool stopped_ = false;
  std::deque<std::function<void()>> missed_;
};

}  // namespace candela::testing
