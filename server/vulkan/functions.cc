#include "server/vulkan/functions.h"

#include <dlfcn.h>

#include <string>
#include <type_traits>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

namespace candela {

#define CANDELA_DEFINE(name) PFN_##name name = nullptr;
CANDELA_VULKAN_FUNCTIONS(CANDELA_DEFINE)
#undef CANDELA_DEFINE

namespace {

constexpr char kLoader[] = "libvulkan.so.1";

// As with a library that the program is linked with, what is preloaded comes first.
absl::Status look_up() {
  if (dlopen(kLoader, RTLD_NOW | RTLD_GLOBAL) == nullptr) {
    return absl::FailedPreconditionError(absl::StrCat("no Vulkan loader found: ", kInstallDriver));
  }
  absl::Status status;
  const auto find = [&status](const char* name, auto& function) {
    function = reinterpret_cast<std::remove_reference_t<decltype(function)>>(dlsym(RTLD_DEFAULT, name));
    if (function != nullptr) return;
    status.Update(absl::FailedPreconditionError(absl::StrCat("the Vulkan loader ", kLoader, " has no ", name,
                                                             "; install one of Vulkan 1.2 or later")));
  };
#define CANDELA_FIND(name) find(#name, name);
  CANDELA_VULKAN_FUNCTIONS(CANDELA_FIND)
#undef CANDELA_FIND
  return status;
}

}  // namespace

absl::Status load_vulkan() {
  static const absl::Status loaded = look_up();
  return loaded;
}

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
