// In a build with CANDELA_VALIDATION, a misuse of Vulkan ends the process that does it.
#include <gtest/gtest.h>

#include "server/vulkan/device.h"
#include "server/vulkan/functions.h"

#ifdef CANDELA_VALIDATION
namespace candela::testing {
namespace {

// A fence with an unknown flag, on a device that nobody asked to validate.
void misuse_vulkan() {
  const absl::StatusOr<std::unique_ptr<Device>> device = Device::create({});
  VkFenceCreateInfo info{};
  info.sType = VK_STRUCTURE_TYPE_FENCE_CREATE_INFO;
  info.flags = 2;
  VkFence fence = VK_NULL_HANDLE;
  if (vkCreateFence((*device)->handle(), &info, nullptr, &fence) == VK_SUCCESS) {
    vkDestroyFence((*device)->handle(), fence, nullptr);
  }
}

TEST(ValidationDeathTest, AMessageEndsTheProcess) {
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  EXPECT_DEATH(misuse_vulkan(), "vulkan validation: .*flags");
}

}  // namespace
}  // namespace candela::testing
#endif
