// Helpers for tests that use a Vulkan driver: how long it is kept, and when its devices are closed.
#pragma once

#include <gtest/gtest.h>

namespace candela::testing {

// Calls `close` after the last test of the process. Devices that tests share are destroyed there: at the
// process's exit, some drivers and the validation layers are gone before the statics are.
class CloseAfterTests : public ::testing::Environment {
 public:
  explicit CloseAfterTests(void (*close)()) : close_(close) {}
  void TearDown() override { close_(); }

 private:
  void (*const close_)();
};

// Keeps a Vulkan instance for the rest of the process, for the leak sanitizer. The software driver is
// unloaded with the last instance and leaks a little then.
void keep_driver_loaded();

}  // namespace candela::testing
