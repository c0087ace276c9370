// A process that can be stopped and go on again, as by SIGSTOP and SIGCONT.
#pragma once

#include <deque>
#include <functional>
#include <string>
#include <utility>

#include "tests/simulator/world.h"

namespace candela::testing {

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
