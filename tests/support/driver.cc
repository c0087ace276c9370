#include "tests/support/driver.h"

#include <gtest/gtest.h>

#include "server/vulkan/functions.h"

namespace candela::testing {

void keep_driver_loaded() {
  static VkInstance instance = VK_NULL_HANDLE;
  if (instance != VK_NULL_HANDLE) return;
  ASSERT_EQ(load_vulkan(), absl::OkStatus());
  VkInstanceCreateInfo info{};
  info.sType = VK_STRUCTURE_TYPE_INSTANCE_CREATE_INFO;
  EXPECT_EQ(vkCreateInstance(&info, nullptr, &instance), VK_SUCCESS);
}

}  // namespace candela::testing
