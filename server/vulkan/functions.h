// Vulkan's functions. They are looked up in its loader when the first of them is needed, so that programs
// start without the loader, and run where there is none.
#pragma once

#include <vulkan/vulkan.h>

#include "absl/status/status.h"

// Every function that Candela calls, without those of extensions.
#define CANDELA_VULKAN_FUNCTIONS(F)           \
  F(vkAllocateCommandBuffers)                 \
  F(vkAllocateMemory)                         \
  F(vkBeginCommandBuffer)                     \
  F(vkBindBufferMemory)                       \
  F(vkCmdBindPipeline)                        \
  F(vkCmdCopyBuffer)                          \
  F(vkCmdDispatchBase)                        \
  F(vkCmdFillBuffer)                          \
  F(vkCmdPipelineBarrier)                     \
  F(vkCmdPushConstants)                       \
  F(vkCmdResetQueryPool)                      \
  F(vkCmdUpdateBuffer)                        \
  F(vkCmdWriteTimestamp)                      \
  F(vkCreateBuffer)                           \
  F(vkCreateBufferView)                       \
  F(vkCreateCommandPool)                      \
  F(vkCreateComputePipelines)                 \
  F(vkCreateDescriptorSetLayout)              \
  F(vkCreateDevice)                           \
  F(vkCreateFence)                            \
  F(vkCreateInstance)                         \
  F(vkCreatePipelineLayout)                   \
  F(vkCreateQueryPool)                        \
  F(vkCreateShaderModule)                     \
  F(vkDestroyBuffer)                          \
  F(vkDestroyBufferView)                      \
  F(vkDestroyCommandPool)                     \
  F(vkDestroyDescriptorSetLayout)             \
  F(vkDestroyDevice)                          \
  F(vkDestroyFence)                           \
  F(vkDestroyInstance)                        \
  F(vkDestroyPipeline)                        \
  F(vkDestroyPipelineLayout)                  \
  F(vkDestroyQueryPool)                       \
  F(vkDestroyShaderModule)                    \
  F(vkEndCommandBuffer)                       \
  F(vkEnumerateDeviceExtensionProperties)     \
  F(vkEnumeratePhysicalDevices)               \
  F(vkFreeMemory)                             \
  F(vkGetBufferDeviceAddress)                 \
  F(vkGetBufferMemoryRequirements)            \
  F(vkGetDeviceProcAddr)                      \
  F(vkGetDeviceQueue)                         \
  F(vkGetInstanceProcAddr)                    \
  F(vkGetPhysicalDeviceFeatures2)             \
  F(vkGetPhysicalDeviceMemoryProperties)      \
  F(vkGetPhysicalDeviceProperties)            \
  F(vkGetPhysicalDeviceProperties2)           \
  F(vkGetPhysicalDeviceQueueFamilyProperties) \
  F(vkGetQueryPoolResults)                    \
  F(vkMapMemory)                              \
  F(vkQueueSubmit)                            \
  F(vkResetCommandPool)                       \
  F(vkResetFences)                            \
  F(vkWaitForFences)

namespace candela {

// What to do where no device of Vulkan can be used, as the end of an error.
inline constexpr char kInstallDriver[] =
    "install Debian's mesa-vulkan-drivers (the lavapipe software device) or your GPU's driver, or set "
    "VK_ICD_FILENAMES to a driver's .json file; --device host needs none, but makes no environments";

// They hide the functions of the same names that vulkan.h declares, which no library is linked for.
#define CANDELA_DECLARE(name) extern PFN_##name name;
CANDELA_VULKAN_FUNCTIONS(CANDELA_DECLARE)
#undef CANDELA_DECLARE

// Looks the functions up, once; none of them may be called before. FAILED_PRECONDITION, naming the package to
// install, if there is no loader. Any thread.
absl::Status load_vulkan();

// Converts VkResult to absl::Status.

// OK for VK_SUCCESS, RESOURCE_EXHAUSTED if memory ran out, UNAVAILABLE if the device is lost, INTERNAL
// otherwise. `what` names the call, such as "vkQueueSubmit".
absl::Status vulkan_status(VkResult result, const char* what);

}  // namespace candela

#define CANDELA_VK(call)                                                                                     \
  do {                                                                                                       \
    if (absl::Status candela_vk_status = ::candela::vulkan_status((call), #call); !candela_vk_status.ok()) { \
      return candela_vk_status;                                                                              \
    }                                                                                                        \
  } while (false)
