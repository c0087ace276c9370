#include "server/vulkan/device.h"

#include <vulkan/vulkan.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <iterator>
#include <optional>
#include <system_error>
#include <utility>
#include <vector>

#include "absl/cleanup/cleanup.h"
#include "absl/status/statusor.h"
#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "server/base/status_macros.h"
#include "server/vulkan/functions.h"

namespace candela {

bool has_gpu(const std::filesystem::path& devices) {
  std::error_code error;
  for (const char* const own : {"nvidiactl", "dxg"}) {
    if (std::filesystem::exists(devices / own, error)) return true;
  }
  for (std::filesystem::directory_iterator node(devices / "dri", error), end; !error && node != end;
       node.increment(error)) {
    if (absl::StartsWith(node->path().filename().string(), "renderD")) return true;
  }
  return false;
}

namespace {

// The physical devices of a machine, and whether each can render.

// DeviceSummary::type of a processor.
constexpr char kCpuType[] = "CPU";

struct PhysicalDevice {
  VkPhysicalDevice handle = VK_NULL_HANDLE;
  VkPhysicalDeviceType type = VK_PHYSICAL_DEVICE_TYPE_OTHER;
  uint32_t queue_family = 0;
  uint32_t timestamp_bits = 0;
  double timestamp_period_ns = 0.0;
  VkPhysicalDeviceMemoryProperties memory = {};
  DeviceSummary summary;
};

// The best first.
constexpr std::pair<VkPhysicalDeviceType, const char*> kTypes[] = {
    {VK_PHYSICAL_DEVICE_TYPE_DISCRETE_GPU, "discrete GPU"},
    {VK_PHYSICAL_DEVICE_TYPE_INTEGRATED_GPU, "integrated GPU"},
    {VK_PHYSICAL_DEVICE_TYPE_VIRTUAL_GPU, "virtual GPU"},
    {VK_PHYSICAL_DEVICE_TYPE_CPU, kCpuType},
};

// Lower is better.
size_t rank(VkPhysicalDeviceType type) {
  size_t i = 0;
  while (i < std::size(kTypes) && kTypes[i].first != type) ++i;
  return i;
}

absl::Status no_driver() {
  return absl::FailedPreconditionError(absl::StrCat("no Vulkan driver found: ", kInstallDriver));
}

const char* type_name(VkPhysicalDeviceType type) {
  return rank(type) < std::size(kTypes) ? kTypes[rank(type)].second : "other";
}

constexpr VkMemoryPropertyFlags kHost =
    VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT | VK_MEMORY_PROPERTY_HOST_COHERENT_BIT;
constexpr VkMemoryPropertyFlags kUnified =
    kHost | VK_MEMORY_PROPERTY_DEVICE_LOCAL_BIT | VK_MEMORY_PROPERTY_HOST_CACHED_BIT;

// The first allowed type with all of `wanted` and as many of `liked` as possible. Types with properties
// beyond the usual ones (protected, device-coherent) need features that are not enabled.
std::optional<uint32_t> find_type(const VkPhysicalDeviceMemoryProperties& memory,
                                  VkMemoryPropertyFlags wanted, VkMemoryPropertyFlags liked,
                                  uint32_t allowed) {
  std::optional<uint32_t> best;
  int best_score = -1;
  for (uint32_t i = 0; i < memory.memoryTypeCount; ++i) {
    const VkMemoryPropertyFlags flags = memory.memoryTypes[i].propertyFlags;
    if ((allowed >> i & 1) == 0 || (flags & wanted) != wanted || (flags & ~kUnified) != 0) continue;
    const int score = __builtin_popcount(flags & liked);
    if (score > best_score) {
      best = i;
      best_score = score;
    }
  }
  return best;
}

std::string missing_feature(VkPhysicalDevice handle) {
  VkPhysicalDeviceVulkan12Features features12{};
  features12.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_2_FEATURES;
  VkPhysicalDeviceFeatures2 features{};
  features.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_FEATURES_2;
  features.pNext = &features12;
  vkGetPhysicalDeviceFeatures2(handle, &features);
  if (!features12.bufferDeviceAddress) return "no bufferDeviceAddress";
  if (!features.features.shaderInt64) return "no shaderInt64";
  uint32_t count = 0;
  vkEnumerateDeviceExtensionProperties(handle, nullptr, &count, nullptr);
  std::vector<VkExtensionProperties> extensions(count);
  vkEnumerateDeviceExtensionProperties(handle, nullptr, &count, extensions.data());
  const bool push = std::any_of(extensions.begin(), extensions.end(), [](const VkExtensionProperties& e) {
    return std::strcmp(e.extensionName, VK_KHR_PUSH_DESCRIPTOR_EXTENSION_NAME) == 0;
  });
  return push ? "" : "no " VK_KHR_PUSH_DESCRIPTOR_EXTENSION_NAME;
}

PhysicalDevice describe(VkPhysicalDevice handle, uint32_t index) {
  PhysicalDevice device;
  device.handle = handle;

  VkPhysicalDeviceProperties base;
  vkGetPhysicalDeviceProperties(handle, &base);
  DeviceSummary& summary = device.summary;
  summary.index = index;
  summary.name = base.deviceName;
  summary.type = type_name(base.deviceType);
  summary.api_version =
      absl::StrFormat("%d.%d.%d", VK_API_VERSION_MAJOR(base.apiVersion),
                      VK_API_VERSION_MINOR(base.apiVersion), VK_API_VERSION_PATCH(base.apiVersion));
  device.type = base.deviceType;
  device.timestamp_period_ns = base.limits.timestampPeriod;
  if (base.apiVersion < VK_API_VERSION_1_2) {
    summary.unusable = "Vulkan " + summary.api_version + ", 1.2 is needed";
    return device;
  }

  VkPhysicalDeviceMaintenance3Properties maintenance{};
  maintenance.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_MAINTENANCE_3_PROPERTIES;
  VkPhysicalDeviceSubgroupProperties subgroup{};
  subgroup.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_SUBGROUP_PROPERTIES;
  subgroup.pNext = &maintenance;
  VkPhysicalDeviceDriverProperties driver{};
  driver.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_DRIVER_PROPERTIES;
  driver.pNext = &subgroup;
  VkPhysicalDeviceProperties2 properties{};
  properties.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_PROPERTIES_2;
  properties.pNext = &driver;
  vkGetPhysicalDeviceProperties2(handle, &properties);
  summary.driver = absl::StrCat(driver.driverName, " ", driver.driverInfo);
  // Textures are read as texel buffers of 16 bytes a texel.
  summary.max_allocation_bytes = std::min<uint64_t>(maintenance.maxMemoryAllocationSize,
                                                    uint64_t{base.limits.maxTexelBufferElements} * 16);

  summary.unusable = missing_feature(handle);
  constexpr VkSubgroupFeatureFlags kSubgroup =
      VK_SUBGROUP_FEATURE_BASIC_BIT | VK_SUBGROUP_FEATURE_ARITHMETIC_BIT;
  if ((subgroup.supportedOperations & kSubgroup) != kSubgroup) summary.unusable = "no subgroup arithmetic";

  uint32_t count = 0;
  vkGetPhysicalDeviceQueueFamilyProperties(handle, &count, nullptr);
  std::vector<VkQueueFamilyProperties> families(count);
  vkGetPhysicalDeviceQueueFamilyProperties(handle, &count, families.data());
  const auto family = std::find_if(families.begin(), families.end(), [](const VkQueueFamilyProperties& f) {
    return (f.queueFlags & VK_QUEUE_COMPUTE_BIT) != 0;
  });
  if (family == families.end()) {
    summary.unusable = "no compute queue";
    return device;
  }
  device.queue_family = static_cast<uint32_t>(family - families.begin());
  device.timestamp_bits = family->timestampValidBits;
  vkGetPhysicalDeviceMemoryProperties(handle, &device.memory);
  summary.unified_memory = find_type(device.memory, kUnified, 0, UINT32_MAX).has_value();
  return device;
}

// Finds a memory type for `use` among `allowed`, if there is one. `unified`: every use takes memory that is
// device-local, mapped and cached at once.
std::optional<uint32_t> find_memory_type(const VkPhysicalDeviceMemoryProperties& memory, MemoryUse use,
                                         bool unified, uint32_t allowed) {
  if (unified) return find_type(memory, kUnified, 0, allowed);
  switch (use) {
    case MemoryUse::kDevice:
      return find_type(memory, VK_MEMORY_PROPERTY_DEVICE_LOCAL_BIT, 0, allowed);
    case MemoryUse::kUpload:
      return find_type(memory, kHost, 0, allowed);
    case MemoryUse::kReadback:
      return find_type(memory, kHost, VK_MEMORY_PROPERTY_HOST_CACHED_BIT, allowed);
  }
  return std::nullopt;
}

// Creates an instance of Vulkan 1.2, with validation if it is wanted.
absl::StatusOr<VkInstance> create_instance(bool validation) {
  RETURN_IF_ERROR(load_vulkan());
  VkApplicationInfo application{};
  application.sType = VK_STRUCTURE_TYPE_APPLICATION_INFO;
  application.pApplicationName = "candela";
  application.apiVersion = VK_API_VERSION_1_2;

  static constexpr const char* kLayer = "VK_LAYER_KHRONOS_validation";
  static constexpr const char* kDebugUtils = VK_EXT_DEBUG_UTILS_EXTENSION_NAME;
  static constexpr VkValidationFeatureEnableEXT kSynchronisation =
      VK_VALIDATION_FEATURE_ENABLE_SYNCHRONIZATION_VALIDATION_EXT;
  VkValidationFeaturesEXT features{};
  features.sType = VK_STRUCTURE_TYPE_VALIDATION_FEATURES_EXT;
  features.enabledValidationFeatureCount = 1;
  features.pEnabledValidationFeatures = &kSynchronisation;

  VkInstanceCreateInfo info{};
  info.sType = VK_STRUCTURE_TYPE_INSTANCE_CREATE_INFO;
  info.pApplicationInfo = &application;
  if (validation) {
    info.pNext = &features;
    info.enabledLayerCount = 1;
    info.ppEnabledLayerNames = &kLayer;
    info.enabledExtensionCount = 1;
    info.ppEnabledExtensionNames = &kDebugUtils;
  }
  VkInstance instance = VK_NULL_HANDLE;
  const VkResult result = vkCreateInstance(&info, nullptr, &instance);
  if (result == VK_ERROR_LAYER_NOT_PRESENT) {
    return absl::FailedPreconditionError(
        "no validation layer: install Debian's vulkan-validationlayers, or leave out --validation");
  }
  if (result == VK_ERROR_INCOMPATIBLE_DRIVER) return no_driver();
  RETURN_IF_ERROR(vulkan_status(result, "vkCreateInstance"));
  return instance;
}

// Every device of the instance, in the driver's order, usable or not.
absl::StatusOr<std::vector<PhysicalDevice>> physical_devices(VkInstance instance) {
  uint32_t count = 0;
  CANDELA_VK(vkEnumeratePhysicalDevices(instance, &count, nullptr));
  std::vector<VkPhysicalDevice> handles(count);
  CANDELA_VK(vkEnumeratePhysicalDevices(instance, &count, handles.data()));
  if (handles.empty()) return no_driver();
  std::vector<PhysicalDevice> devices;
  for (VkPhysicalDevice handle : handles) {
    devices.push_back(describe(handle, static_cast<uint32_t>(devices.size())));
  }
  return devices;
}

// The device that DeviceOptions::selector names. Fails as Device::create does.
absl::StatusOr<PhysicalDevice> select_device(const std::vector<PhysicalDevice>& devices,
                                             const std::string& selector) {
  const PhysicalDevice* best = nullptr;
  uint32_t index = 0;
  const bool by_index = absl::SimpleAtoi(selector, &index);
  const std::string wanted = absl::AsciiStrToLower(selector);
  for (const PhysicalDevice& device : devices) {
    const DeviceSummary& summary = device.summary;
    const bool matches = selector.empty() ? summary.unusable.empty()
                         : by_index       ? summary.index == index
                                          : absl::StrContains(absl::AsciiStrToLower(summary.name), wanted);
    if (!matches) continue;
    const auto order = [](const PhysicalDevice& d) {
      return std::pair(!d.summary.unusable.empty(), rank(d.type));
    };
    if (best == nullptr || order(device) < order(*best)) best = &device;
  }
  if (best != nullptr && best->summary.unusable.empty()) return *best;

  const std::string there = absl::StrJoin(devices, "; ", [](std::string* out, const PhysicalDevice& device) {
    const DeviceSummary& summary = device.summary;
    absl::StrAppend(out, summary.index, ": ", summary.name, " (", summary.type, ")",
                    summary.unusable.empty() ? "" : ", unusable: " + summary.unusable);
  });
  if (selector.empty()) return absl::NotFoundError("no Vulkan device can be used: " + there);
  return absl::NotFoundError(absl::StrFormat(
      "device \"%s\" %s; there are: %s", selector,
      best == nullptr ? "matches nothing" : "cannot be used: " + best->summary.unusable, there));
}

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
