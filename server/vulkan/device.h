// The device: Vulkan, or the host as a device without it. Whether there is a GPU is known without Vulkan.
#pragma once

#include <vulkan/vulkan.h>

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/time/time.h"

namespace candela {

// Whether the kernel shows one among its devices: a render node of DRM, or NVIDIA's or WSL's own. It may
// still have no driver for Vulkan.
bool has_gpu(const std::filesystem::path& devices = "/dev");

// One headless Vulkan device with one compute queue, or the host in its place.

// The selector of the host: nothing of Vulkan is loaded, and its buffers are memory of the heap.
inline constexpr char kHostDevice[] = "host";

struct DeviceOptions {
  // Empty: the first discrete GPU, integrated GPU, virtual GPU or CPU, in this order. Otherwise kHostDevice,
  // an index in list_devices(), or part of a device's name; case does not matter.
  std::string selector;
  // With an empty selector: the host unless there is a GPU that can be used.
  bool host_without_gpu = false;
  // Validation and synchronisation validation; their messages are counted and printed to stderr. A build with
  // CANDELA_VALIDATION validates every device, and its first message ends the process.
  bool validation = false;
  // Do not use unified memory, so that tests cover the staging copies without a GPU.
  bool staging = false;
  // A device that has not answered for this long counts as hung. A software device on a machine that is busy
  // takes seconds for a large frame.
  absl::Duration hang_limit = absl::Seconds(90);
};

struct DeviceSummary {
  uint32_t index = 0;
  std::string name;
  std::string type;                   // "discrete GPU", "integrated GPU", "virtual GPU", "CPU" or "other"
  std::string driver;                 // name and version
  std::string api_version;            // "1.3.230"; empty, like the driver, of the host
  bool unified_memory = false;        // device memory is mapped and cached: no staging copies
  uint64_t max_allocation_bytes = 0;  // of one texture
  std::string unusable;               // why it cannot render; empty if it can
};

// FAILED_PRECONDITION if there is no Vulkan driver, naming the package to install and the variable to set.
absl::StatusOr<std::vector<DeviceSummary>> list_devices();

// The kind of memory that a buffer needs.
enum class MemoryUse : uint32_t {
  kDevice,    // fastest for shaders; also mapped if memory is unified
  kUpload,    // written by the host, read by copies
  kReadback,  // written by copies or shaders, read by the host: cached
};

// Thread-safe, except that only one thread at a time may use the queue.
class Device {
 public:
  // NOT_FOUND, listing the devices, if none matches the selector; otherwise fails as list_devices() does.
  static absl::StatusOr<std::unique_ptr<Device>> create(const DeviceOptions& options);
  static std::unique_ptr<Device> host();
  ~Device();
  Device(const Device&) = delete;
  Device& operator=(const Device&) = delete;

  const DeviceSummary& summary() const { return summary_; }
  bool unified_memory() const { return summary_.unified_memory; }

  // Only its memory can be used: it has no handle and no queue, and nothing can be submitted.
  bool is_host() const { return device_ == VK_NULL_HANDLE; }
  VkDevice handle() const { return device_; }
  VkQueue queue() const { return queue_; }
  uint32_t queue_family() const { return queue_family_; }
  double timestamp_period_ns() const { return timestamp_period_ns_; }
  // Valid bits of a timestamp, as a mask; 0 if the queue has no timestamps.
  uint64_t timestamp_mask() const { return timestamp_mask_; }
  PFN_vkCmdPushDescriptorSetKHR push_descriptors() const { return push_descriptors_; }
  // Index of a memory type for `use` among `allowed`, a mask as VkMemoryRequirements has it.
  absl::StatusOr<uint32_t> memory_type(MemoryUse use, uint32_t allowed) const;

  // A lost device stays lost: every submission fails with VK_ERROR_DEVICE_LOST. Any thread.
  bool lost() const { return lost_; }
  // Called when the driver reports the loss, and by tests.
  void lose() const { lost_ = true; }

  // A hung device is lost, too. It may write to the memory of its last submission at any time, so buffers are
  // not freed any more, and it must not be destroyed. Any thread.
  bool hung() const { return hung_; }
  absl::Duration hang_limit() const { return hang_limit_; }
  // Called when a submission does not end within hang_limit().
  void found_hung() const { hung_ = lost_ = true; }

  // For tests: the submission after the next `submissions` never ends.
  void hang_after(int submissions) const { until_hang_ = submissions; }
  // Counts a submission. Returns true if it is to hang.
  bool next_hangs() const { return until_hang_ >= 0 && until_hang_-- == 0; }
  // For tests: every allocation fails, as some drivers' do for good after the process ran out of descriptors.
  void refuse_memory() const { refuses_memory_ = true; }
  bool refuses_memory() const { return refuses_memory_; }

  // Warnings and errors that the validation layers have reported so far.
  uint64_t validation_messages() const { return validation_messages_; }

 private:
  Device() = default;
  absl::Status open(const DeviceOptions& options);

  VkInstance instance_ = VK_NULL_HANDLE;
  VkDebugUtilsMessengerEXT messenger_ = VK_NULL_HANDLE;
  VkDevice device_ = VK_NULL_HANDLE;
  VkQueue queue_ = VK_NULL_HANDLE;
  PFN_vkCmdPushDescriptorSetKHR push_descriptors_ = nullptr;
  uint32_t queue_family_ = 0;
  double timestamp_period_ns_ = 0.0;
  uint64_t timestamp_mask_ = 0;
  VkPhysicalDeviceMemoryProperties memory_ = {};
  DeviceSummary summary_;
  std::atomic<uint64_t> validation_messages_ = 0;
  absl::Duration hang_limit_;
  mutable std::atomic<bool> lost_ = false;
  mutable std::atomic<bool> hung_ = false;
  mutable std::atomic<int> until_hang_ = -1;
  mutable std::atomic<bool> refuses_memory_ = false;
};

}  // namespace candela
