// The physical devices of a machine, and whether each can render. Internal to server/vulkan.
#pragma once

#include <vulkan/vulkan.h>

#include <optional>
#include <vector>

#include "absl/status/statusor.h"
#include "server/vulkan/device.h"

namespace candela {

// DeviceSummary::type of a processor.
inline constexpr char kCpuType[] = "CPU";

struct PhysicalDevice {
  VkPhysicalDevice handle = VK_NULL_HANDLE;
  VkPhysicalDeviceType type = VK_PHYSICAL_DEVICE_TYPE_OTHER;
  uint32_t queue_family = 0;
  uint32_t timestamp_bits = 0;
  double timestamp_period_ns = 0.0;
  VkPhysicalDeviceMemoryProperties memory = {};
  DeviceSummary summary;
};

// Creates an instance of Vulkan 1.2, with validation if it is wanted.
absl::StatusOr<VkInstance> create_instance(bool validation);

// Every device of the instance, in the driver's order, usable or not.
absl::StatusOr<std::vector<PhysicalDevice>> physical_devices(VkInstance instance);

// Finds a memory type for `use` among `allowed`, if there is one. `unified`: every use takes memory that is
// device-local, mapped and cached at once.
std::optional<uint32_t> find_memory_type(const VkPhysicalDeviceMemoryProperties& memory, MemoryUse use,
                                         bool unified, uint32_t allowed);

// The device that DeviceOptions::selector names. Fails as Device::create does.
absl::StatusOr<PhysicalDevice> select_device(const std::vector<PhysicalDevice>& devices,
                                             const std::string& selector);

}  // namespace candela
