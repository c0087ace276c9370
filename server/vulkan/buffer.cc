#include "server/vulkan/buffer.h"

#include <sys/mman.h>

#include <cstdint>
#include <utility>

#include "absl/strings/str_format.h"
#include "server/base/check.h"
#include "server/base/status_macros.h"
#include "server/vulkan/functions.h"

namespace candela {
namespace {

constexpr uintptr_t kLargePage = uintptr_t{2} << 20;  // of x86-64 and of arm64 with pages of 4 KiB
constexpr uint64_t kCacheLine = 64;

// Asks for large pages, which spare the host's passes misses of the TLB. A kernel that has none, and a device
// whose memory is not the host's, decline.
void advise_large_pages(void* memory, uint64_t bytes) {
  const auto begin = reinterpret_cast<uintptr_t>(memory);
  const uintptr_t first = (begin + kLargePage - 1) & ~(kLargePage - 1);
  const uintptr_t last = (begin + bytes) & ~(kLargePage - 1);
  if (first < last) madvise(reinterpret_cast<void*>(first), last - first, MADV_HUGEPAGE);
}

}  // namespace

absl::StatusOr<Buffer> Buffer::create(const Device& device, uint64_t bytes, MemoryUse use) {
  CHECK(bytes >= 16);
  Buffer b;
  b.device_ = &device;
  b.bytes_ = bytes;
  if (device.is_host()) {
    RETURN_IF_ERROR(b.take_heap());
    return b;
  }

  VkBufferCreateInfo info{};
  info.sType = VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO;
  info.size = bytes;
  info.usage = VK_BUFFER_USAGE_STORAGE_BUFFER_BIT | VK_BUFFER_USAGE_SHADER_DEVICE_ADDRESS_BIT |
               VK_BUFFER_USAGE_UNIFORM_TEXEL_BUFFER_BIT | VK_BUFFER_USAGE_TRANSFER_SRC_BIT |
               VK_BUFFER_USAGE_TRANSFER_DST_BIT;
  CANDELA_VK(vkCreateBuffer(device.handle(), &info, nullptr, &b.buffer_));

  VkMemoryRequirements requirements;
  vkGetBufferMemoryRequirements(device.handle(), b.buffer_, &requirements);
  VkMemoryAllocateFlagsInfo flags{};
  flags.sType = VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_FLAGS_INFO;
  flags.flags = VK_MEMORY_ALLOCATE_DEVICE_ADDRESS_BIT;
  VkMemoryAllocateInfo allocation{};
  allocation.sType = VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_INFO;
  allocation.pNext = &flags;
  allocation.allocationSize = requirements.size;
  ASSIGN_OR_RETURN(allocation.memoryTypeIndex, device.memory_type(use, requirements.memoryTypeBits));
  if (device.refuses_memory()) return vulkan_status(VK_ERROR_OUT_OF_DEVICE_MEMORY, "vkAllocateMemory");
  CANDELA_VK(vkAllocateMemory(device.handle(), &allocation, nullptr, &b.memory_));
  CANDELA_VK(vkBindBufferMemory(device.handle(), b.buffer_, b.memory_, 0));
  if (use != MemoryUse::kDevice || device.unified_memory()) {
    void* mapped = nullptr;
    CANDELA_VK(vkMapMemory(device.handle(), b.memory_, 0, VK_WHOLE_SIZE, 0, &mapped));
    b.mapped_ = static_cast<std::byte*>(mapped);
    advise_large_pages(mapped, bytes);
  }
  if (use == MemoryUse::kDevice) {
    VkBufferViewCreateInfo view_info{};
    view_info.sType = VK_STRUCTURE_TYPE_BUFFER_VIEW_CREATE_INFO;
    view_info.buffer = b.buffer_;
    view_info.format = VK_FORMAT_R32G32B32A32_UINT;
    view_info.range = VK_WHOLE_SIZE;
    CANDELA_VK(vkCreateBufferView(device.handle(), &view_info, nullptr, &b.view_));
  }
  VkBufferDeviceAddressInfo address{};
  address.sType = VK_STRUCTURE_TYPE_BUFFER_DEVICE_ADDRESS_INFO;
  address.buffer = b.buffer_;
  b.address_ = vkGetBufferDeviceAddress(device.handle(), &address);
  return b;
}

absl::Status Buffer::take_heap() {
  const uint64_t alignment = bytes_ < kLargePage ? kCacheLine : kLargePage;
  const uint64_t whole = (bytes_ + kCacheLine - 1) / kCacheLine * kCacheLine;
  void* memory = nullptr;
  if (device_->refuses_memory() || posix_memalign(&memory, alignment, whole) != 0) {
    return absl::ResourceExhaustedError(absl::StrFormat("the host has no memory for %d bytes", bytes_));
  }
  heap_.reset(static_cast<std::byte*>(memory));
  mapped_ = heap_.get();
  advise_large_pages(memory, bytes_);
  return absl::OkStatus();
}

Buffer::Buffer(Buffer&& other) noexcept { *this = std::move(other); }

Buffer& Buffer::operator=(Buffer&& other) noexcept {
  std::swap(device_, other.device_);
  std::swap(buffer_, other.buffer_);
  std::swap(memory_, other.memory_);
  std::swap(view_, other.view_);
  std::swap(address_, other.address_);
  std::swap(bytes_, other.bytes_);
  std::swap(mapped_, other.mapped_);
  std::swap(heap_, other.heap_);
  return *this;
}

Buffer::~Buffer() {
  if (device_ == nullptr || device_->is_host() || device_->hung()) return;
  if (view_ != VK_NULL_HANDLE) vkDestroyBufferView(device_->handle(), view_, nullptr);
  if (buffer_ != VK_NULL_HANDLE) vkDestroyBuffer(device_->handle(), buffer_, nullptr);
  if (memory_ != VK_NULL_HANDLE) vkFreeMemory(device_->handle(), memory_, nullptr);
}

}  // namespace candela
