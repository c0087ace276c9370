#include "tests/simulator/process.h"

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

}  // namespace candela::testing
