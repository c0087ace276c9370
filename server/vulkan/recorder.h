// Records one command buffer at a time, submits it and waits.
#pragma once

#include <vulkan/vulkan.h>

#include <cstdint>
#include <span>
#include <vector>

#include "absl/status/statusor.h"
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

  // UNAVAILABLE if the device hangs; then its last submission still uses everything that it was given.
  absl::Status usable() const;
  // Fails as usable() does.
  absl::Status begin();

  // Everything recorded from here to the next mark, or to the end, is timed as `name`. The string outlives
  // the recorder.
  void mark(const char* name);

  // What the dispatches that follow run. `reads` are the texel buffers of bindings 0.., at most
  // PipelineCache::kReads.
  void bind(VkPipeline pipeline, VkPipelineLayout layout, std::span<const VkBufferView> reads,
            const VkDescriptorBufferInfo& written, const void* push, uint32_t push_bytes);
  // Runs work groups x0 to x1 - 1 of rows y0 to y1 - 1. Dispatches without a barrier between them have no
  // order.
  void dispatch(uint32_t x0, uint32_t y0, uint32_t x1, uint32_t y1);
  void fill_zero(const Buffer& buffer);
  // The same for `bytes` from `offset` on; multiples of 4.
  void fill_zero(const Buffer& buffer, uint64_t offset, uint64_t bytes);
  // Copies `bytes` from `data` now, and into the buffer when the commands run. A multiple of 4.
  void update(const Buffer& buffer, const void* data, uint64_t bytes);
  void copy(const Buffer& from, const Buffer& to, uint64_t bytes);
  // The same from the byte `offset` on, in both.
  void copy_part(const Buffer& from, const Buffer& to, uint64_t offset, uint64_t bytes);
  // The same from the byte `offset` of `from` to the beginning of `to`.
  void copy_from(const Buffer& from, uint64_t offset, const Buffer& to, uint64_t bytes);

  // Everything recorded before is finished and visible, on the device, to everything recorded after. Only a
  // GPU can reveal a missing barrier: the software device runs in order, and synchronisation validation does
  // not follow writes by address.
  void barrier();
  // The same for the host, after the submission has finished.
  void barrier_to_host();

  // Blocks until the device is done. UNAVAILABLE if the device is lost, or if it is not done within its
  // hang_limit().
  absl::Status submit_and_wait();

  // The times of the last submission, in order. Empty if the device has no timestamps.
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
