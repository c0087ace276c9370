#include "server/vulkan/result.h"

#include <string>

#include "absl/strings/str_format.h"

namespace candela {

absl::Status vulkan_status(VkResult result, const char* what) {
  if (result == VK_SUCCESS) return absl::OkStatus();
  // "vkCreateBuffer(device, ...)" without its arguments.
  const std::string text = what;
  const std::string message =
      absl::StrFormat("%s failed with VkResult %d", text.substr(0, text.find('(')), static_cast<int>(result));
  switch (result) {
    case VK_ERROR_OUT_OF_HOST_MEMORY:
    case VK_ERROR_OUT_OF_DEVICE_MEMORY:
      return absl::ResourceExhaustedError(message + " (out of memory)");
    case VK_ERROR_DEVICE_LOST:
      return absl::UnavailableError(message + " (device lost)");
    default:
      return absl::InternalError(message);
  }
}

}  // namespace candela
