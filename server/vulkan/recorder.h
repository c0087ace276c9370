// Records one command buffer at a time, submits it and waits.
#pragma once

#include <vulkan/vulkan.h>

#include <cstdint>
#include <span>
#include <vector>

#include "absl/status/statusor.h"
#include "server/vulkan/box.h"
#include "server/vulkan/buffer.h"
#include "server/vulkan/device.h"

namespace candela {

// begin(); any of the recording calls; submit_and_wait(). One thread at a time. The device outlives it.
class Recorder {
 public:
  // A span of device time and what was done in it.
  struct Timing {
    const char* name;
    uint64_t ns;
  };

  static absl::StatusOr<Recorder> create(const Device& device);
  Recorder(Recorder&& other) noexcept;
  Recorder& operator=(Recorder&&) = delete;
  ~Recorder();

  absl::Status begin();

  // What is recorded from here to the next mark or the end counts as `name`, a string that lives on.
  void mark(const char* name);

  // `reads` are the texel buffers of bindings 0.., at most PipelineCache::kReads; `groups` the work groups
  // that run, in no order.
  void dispatch(VkPipeline pipeline, VkPipelineLayout layout, std::span<const VkBufferView> reads,
                const VkDescriptorBufferInfo& written, const void* push, uint32_t push_bytes,
                std::span<const Box> groups);
  void fill_zero(const Buffer& buffer);
  // Copies `bytes`, a multiple of 4 and at most 65536, out of `data` now and into the buffer later.
  void update(const Buffer& buffer, const void* data, uint64_t bytes);
  void copy(const Buffer& from, const Buffer& to, uint64_t bytes);

  // All that was recorded before is finished and visible to all that comes after, on the device. The software
  // device runs in order and synchronisation validation does not follow writes by address, so only a GPU can
  // show a missing one.
  void barrier();
  // The same for the host, once the submission has finished.
  void barrier_to_host();

  // Blocks until the device is done. UNAVAILABLE when the device is lost. A device that hangs ends the
  // process: it may still write to memory that could otherwise not be told from free.
  absl::Status submit_and_wait();

  // Of the last submission, in order. Empty where the device has no timestamps.
  std::vector<Timing> timings() const;

 private:
  static constexpr uint32_t kMaxMarks = 64;
  Recorder() = default;
  absl::Status submit_to_device();

  const Device* device_ = nullptr;
  VkCommandPool pool_ = VK_NULL_HANDLE;
  VkCommandBuffer commands_ = VK_NULL_HANDLE;
  VkFence fence_ = VK_NULL_HANDLE;
  VkQueryPool queries_ = VK_NULL_HANDLE;
  std::vector<const char*> marks_;
  std::vector<uint64_t> ticks_;  // one more than marks_
};

}  // namespace candela
