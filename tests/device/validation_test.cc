// In a build with CANDELA_VALIDATION, a misuse of Vulkan ends the process that does it.
#include <gtest/gtest.h>

#include "server/vulkan/device.h"

#ifdef CANDELA_VALIDATION
namespace candela::testing {
namespace {

// A semaphore with an unknown flag, on a device that nobody asked to validate.
void misuse_vulkan() {
  const absl::StatusOr<std::unique_ptr<Device>> device = Device::create({});
  VkSemaphoreCreateInfo info{};
  info.sType = VK_STRUCTURE_TYPE_SEMAPHORE_CREATE_INFO;
  info.flags = 1;
  VkSemaphore semaphore = VK_NULL_HANDLE;
  if (vkCreateSemaphore((*device)->handle(), &info, nullptr, &semaphore) == VK_SUCCESS) {
    vkDestroySemaphore((*device)->handle(), semaphore, nullptr);
  }
}

TEST(ValidationDeathTest, AMessageEndsTheProcess) {
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  EXPECT_DEATH(misuse_vulkan(), "vulkan validation: .*flags");
}

}  // namespace
}  // namespace candela::testing
#endif
