#include "tests/simulator/world.h"

#include <algorithm>
#include <cstdio>

#include "server/base/check.h"

namespace candela::testing {

void Process::tell(std::function<void()> event) {
  if (stopped_) return missed_.push_back(std::move(event));
  event();
  react();
}

void Process::stop() {
  if (!std::exchange(stopped_, true)) world_.note(name_, "is stopped");
}

void Process::go_on() {
  if (!std::exchange(stopped_, false)) return;
  world_.note(name_, "goes on");
  // An event may stop it again.
  while (!missed_.empty() && !stopped_) {
    const std::function<void()> event = std::move(missed_.front());
    missed_.pop_front();
    event();
    react();
  }
}

class World::Alarm final : public Timer {
 public:
  Alarm(World& world, Moment moment) : world_(world), moment_(std::move(moment)) {}
  ~Alarm() override { world_.events_.erase(moment_); }

 private:
  World& world_;
  const Moment moment_;
};

std::chrono::steady_clock::time_point World::steady() {
  return std::chrono::steady_clock::time_point(absl::ToChronoNanoseconds(passed_));
}

bool World::await(absl::Mutex&, const absl::Condition& condition, absl::Duration) {
  CHECK(condition.Eval());  // nobody else could make it true
  return true;
}

World::Moment World::add(absl::Duration wait, std::function<void()> then) {
  const Moment moment{passed_ + std::max(wait, absl::ZeroDuration()), made_++};
  events_.emplace(moment, std::move(then));
  return moment;
}

std::unique_ptr<Timer> World::call_after(absl::Duration wait, std::function<void()> then) {
  return std::make_unique<Alarm>(*this, add(wait, std::move(then)));
}

void World::after(absl::Duration wait, std::function<void()> then) { add(wait, std::move(then)); }

bool World::step() {
  if (events_.empty()) return false;
  auto event = events_.extract(events_.begin());
  passed_ = event.key().first;
  event.mapped()();
  return true;
}

void World::end() {
  // Those that are destroyed may destroy timers.
  while (!events_.empty()) events_.extract(events_.begin());
}

void World::print(const std::string& who, const std::string& what) const {
  std::printf("%12.6f  %-9s %s\n", absl::ToDoubleSeconds(passed_), who.c_str(), what.c_str());
}

}  // namespace candela::testing
