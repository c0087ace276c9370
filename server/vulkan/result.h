// Converts VkResult to absl::Status.
#pragma once

#include <vulkan/vulkan.h>

#include "absl/status/status.h"

namespace candela {

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
