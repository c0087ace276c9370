#include "server/vulkan/device.h"

#include <cstdio>
#include <cstdlib>

#include "absl/cleanup/cleanup.h"
#include "absl/strings/match.h"
#include "absl/strings/str_format.h"
#include "server/base/status_macros.h"
#include "server/vulkan/functions.h"
#include "server/vulkan/gpu.h"
#include "server/vulkan/physical_device.h"
#include "server/vulkan/result.h"

namespace candela {

namespace {

// In a build with CANDELA_VALIDATION every device of every process is validated, and a message ends the
// process.
#ifdef CANDELA_VALIDATION
constexpr bool kAlwaysValidate = true;
#else
constexpr bool kAlwaysValidate = false;
#endif

// As lavapipe has it.
constexpr uint64_t kMaxHostTextureBytes = uint64_t{1} << 31;

VKAPI_ATTR VkBool32 VKAPI_CALL on_validation_message(VkDebugUtilsMessageSeverityFlagBitsEXT,
                                                     VkDebugUtilsMessageTypeFlagsEXT,
                                                     const VkDebugUtilsMessengerCallbackDataEXT* data,
                                                     void* count) {
  ++*static_cast<std::atomic<uint64_t>*>(count);
  std::fprintf(stderr, "vulkan validation: %s\n", data->pMessage);
  if (kAlwaysValidate) std::abort();
  return VK_FALSE;
}

}  // namespace

absl::StatusOr<std::vector<DeviceSummary>> list_devices() {
  ASSIGN_OR_RETURN(VkInstance instance, create_instance(/*validation=*/false));
  const absl::Cleanup destroy = [&] { vkDestroyInstance(instance, nullptr); };
  ASSIGN_OR_RETURN(std::vector<PhysicalDevice> devices, physical_devices(instance));
  std::vector<DeviceSummary> summaries;
  for (const PhysicalDevice& device : devices) summaries.push_back(device.summary);
  return summaries;
}

absl::StatusOr<std::unique_ptr<Device>> Device::create(const DeviceOptions& options) {
  const bool or_host = options.host_without_gpu && options.selector.empty();
  if (absl::EqualsIgnoreCase(options.selector, kHostDevice) || (or_host && !has_gpu())) return host();
  std::unique_ptr<Device> device(new Device);
  const absl::Status opened = device->open(options);
  const bool none = absl::IsFailedPrecondition(opened) || absl::IsNotFound(opened);
  if (or_host && (none || (opened.ok() && device->summary_.type == kCpuType))) return host();
  if (!opened.ok()) return opened;
  return device;
}

std::unique_ptr<Device> Device::host() {
  std::unique_ptr<Device> device(new Device);
  device->summary_.name = kHostDevice;
  device->summary_.type = kCpuType;
  device->summary_.unified_memory = true;
  device->summary_.max_allocation_bytes = kMaxHostTextureBytes;
  return device;
}

absl::Status Device::open(const DeviceOptions& options) {
  const bool validation = options.validation || kAlwaysValidate;
  ASSIGN_OR_RETURN(instance_, create_instance(validation));
  if (validation) {
    VkDebugUtilsMessengerCreateInfoEXT info{};
    info.sType = VK_STRUCTURE_TYPE_DEBUG_UTILS_MESSENGER_CREATE_INFO_EXT;
    info.messageSeverity =
        VK_DEBUG_UTILS_MESSAGE_SEVERITY_WARNING_BIT_EXT | VK_DEBUG_UTILS_MESSAGE_SEVERITY_ERROR_BIT_EXT;
    info.messageType =
        VK_DEBUG_UTILS_MESSAGE_TYPE_VALIDATION_BIT_EXT | VK_DEBUG_UTILS_MESSAGE_TYPE_PERFORMANCE_BIT_EXT;
    info.pfnUserCallback = on_validation_message;
    info.pUserData = &validation_messages_;
    const auto create = reinterpret_cast<PFN_vkCreateDebugUtilsMessengerEXT>(
        vkGetInstanceProcAddr(instance_, "vkCreateDebugUtilsMessengerEXT"));
    if (absl::Status status =
            vulkan_status(create(instance_, &info, nullptr, &messenger_), "vkCreateDebugUtilsMessengerEXT");
        !status.ok()) {
      return status;
    }
  }

  ASSIGN_OR_RETURN(std::vector<PhysicalDevice> devices, physical_devices(instance_));
  ASSIGN_OR_RETURN(PhysicalDevice chosen, select_device(devices, options.selector));

  queue_family_ = chosen.queue_family;
  timestamp_period_ns_ = chosen.timestamp_period_ns;
  timestamp_mask_ = chosen.timestamp_bits == 0 ? 0 : ~uint64_t{0} >> (64 - chosen.timestamp_bits);
  memory_ = chosen.memory;
  summary_ = chosen.summary;
  hang_limit_ = options.hang_limit;
  if (options.staging) summary_.unified_memory = false;

  const float priority = 1.0f;
  VkDeviceQueueCreateInfo queue{};
  queue.sType = VK_STRUCTURE_TYPE_DEVICE_QUEUE_CREATE_INFO;
  queue.queueFamilyIndex = queue_family_;
  queue.queueCount = 1;
  queue.pQueuePriorities = &priority;
  VkPhysicalDeviceVulkan12Features features{};
  features.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_2_FEATURES;
  features.bufferDeviceAddress = VK_TRUE;
  VkPhysicalDeviceFeatures base_features{};
  base_features.shaderInt64 = VK_TRUE;  // arithmetic on addresses
  VkDeviceCreateInfo info{};
  info.sType = VK_STRUCTURE_TYPE_DEVICE_CREATE_INFO;
  info.pNext = &features;
  const char* const extension = VK_KHR_PUSH_DESCRIPTOR_EXTENSION_NAME;
  info.enabledExtensionCount = 1;
  info.ppEnabledExtensionNames = &extension;
  info.pEnabledFeatures = &base_features;
  info.queueCreateInfoCount = 1;
  info.pQueueCreateInfos = &queue;
  CANDELA_VK(vkCreateDevice(chosen.handle, &info, nullptr, &device_));
  push_descriptors_ = reinterpret_cast<PFN_vkCmdPushDescriptorSetKHR>(
      vkGetDeviceProcAddr(device_, "vkCmdPushDescriptorSetKHR"));
  vkGetDeviceQueue(device_, queue_family_, 0, &queue_);
  return absl::OkStatus();
}

absl::StatusOr<uint32_t> Device::memory_type(MemoryUse use, uint32_t allowed) const {
  const std::optional<uint32_t> type = find_memory_type(memory_, use, unified_memory(), allowed);
  if (type) return *type;
  return absl::InternalError(absl::StrFormat("%s has no memory that a buffer of use %d may lie in",
                                             summary_.name, static_cast<int>(use)));
}

Device::~Device() {
  if (device_ != VK_NULL_HANDLE) vkDestroyDevice(device_, nullptr);
  if (messenger_ != VK_NULL_HANDLE) {
    const auto destroy = reinterpret_cast<PFN_vkDestroyDebugUtilsMessengerEXT>(
        vkGetInstanceProcAddr(instance_, "vkDestroyDebugUtilsMessengerEXT"));
    destroy(instance_, messenger_, nullptr);
  }
  if (instance_ != VK_NULL_HANDLE) vkDestroyInstance(instance_, nullptr);
}

}  // namespace candela
