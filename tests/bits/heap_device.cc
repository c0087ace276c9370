// Stands in for candela_vulkan: a device whose memory is the heap's, and that runs no shaders. Linked before
// that library, it is all of Vulkan that the host's executor needs.
#include <cstdlib>
#include <utility>

#include "server/vulkan/buffer.h"
#include "server/vulkan/device.h"

namespace candela {

absl::StatusOr<std::unique_ptr<Device>> Device::create(const DeviceOptions&) {
  std::unique_ptr<Device> device(new Device);
  device->summary_.name = "heap";
  device->summary_.type = "CPU";
  device->summary_.unified_memory = true;
  device->summary_.max_allocation_bytes = uint64_t{1} << 30;
  return device;
}

Device::~Device() = default;

absl::StatusOr<Buffer> Buffer::create(const Device& device, uint64_t bytes, MemoryUse) {
  constexpr uint64_t kAlignment = 4096;
  Buffer b;
  b.device_ = &device;
  b.bytes_ = bytes;
  b.mapped_ = static_cast<std::byte*>(
      std::aligned_alloc(kAlignment, (bytes + kAlignment - 1) / kAlignment * kAlignment));
  if (b.mapped_ == nullptr) return absl::ResourceExhaustedError("the heap has no more memory");
  b.buffer_ = reinterpret_cast<VkBuffer>(b.mapped_);  // not null, as the pool wants to see
  return b;
}

Buffer::Buffer(Buffer&& other) noexcept { *this = std::move(other); }

Buffer& Buffer::operator=(Buffer&& other) noexcept {
  std::swap(device_, other.device_);
  std::swap(buffer_, other.buffer_);
  std::swap(bytes_, other.bytes_);
  std::swap(mapped_, other.mapped_);
  return *this;
}

Buffer::~Buffer() { std::free(mapped_); }

}  // namespace candela
