// A Vulkan buffer with its memory, or memory of the heap in its place. Shaders write it as a storage buffer
// or by its address, and read it as a texel buffer.
#pragma once

#include <vulkan/vulkan.h>

#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <memory>

#include "absl/status/statusor.h"
#include "server/vulkan/device.h"

namespace candela {

// Movable; frees its memory, unless the device hangs and may still write to it. Use from one thread at a
// time. The device outlives it.
class Buffer {
 public:
  // RESOURCE_EXHAUSTED if the device has no memory for it. `bytes` is at least 16. On the host it has no
  // handle, no address and no view.
  static absl::StatusOr<Buffer> create(const Device& device, uint64_t bytes, MemoryUse use);

  Buffer() = default;
  Buffer(Buffer&& other) noexcept;
  Buffer& operator=(Buffer&& other) noexcept;
  ~Buffer();

  VkBuffer handle() const { return buffer_; }
  VkDeviceAddress address() const { return address_; }
  // The texel buffer of kDevice memory, four 32-bit words a texel.
  VkBufferView view() const { return view_; }
  uint64_t bytes() const { return bytes_; }
  // The memory as the host sees it. Null if it cannot be mapped: kDevice on a device without unified memory.
  std::byte* mapped() const { return mapped_; }

 private:
  struct Free {
    void operator()(std::byte* memory) const { std::free(memory); }
  };
  absl::Status take_heap();

  const Device* device_ = nullptr;
  VkBuffer buffer_ = VK_NULL_HANDLE;
  VkDeviceMemory memory_ = VK_NULL_HANDLE;
  VkBufferView view_ = VK_NULL_HANDLE;
  VkDeviceAddress address_ = 0;
  uint64_t bytes_ = 0;
  std::byte* mapped_ = nullptr;
  std::unique_ptr<std::byte[], Free> heap_;  // on the host
};

// The halves of an address, which shaders take as two words.
constexpr uint32_t low(VkDeviceAddress address) { return static_cast<uint32_t>(address); }
constexpr uint32_t high(VkDeviceAddress address) { return static_cast<uint32_t>(address >> 32); }

}  // namespace candela
