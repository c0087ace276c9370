// A cache of one device's compute pipelines, which are compiled when they are first needed.
#pragma once

#include <vulkan/vulkan.h>

#include <cstdint>
#include <map>
#include <span>
#include <utility>
#include <vector>

#include "absl/status/statusor.h"
#include "server/vulkan/device.h"

namespace candela {

// The specialisation constants of a shader, in the order of their ids from 0.
using Constants = std::vector<uint32_t>;

// All shaders share one layout: push constants of at most kPushBytes, up to kReads texel buffers to read, as
// bindings 0.. of set 0, and a storage buffer to write, as binding kReads. Descriptors are pushed, too.
// Buffers that many invocations add to are written by address. One thread at a time. The device outlives it.
class PipelineCache {
 public:
  static constexpr uint32_t kPushBytes = 128;
  static constexpr uint32_t kReads = 4;
  // The largest range that every device can bind for writing at once, and the alignment of its beginning.
  static constexpr uint64_t kMaxWriteBytes = uint64_t{1} << 27;
  static constexpr uint64_t kWriteAlignment = 256;

  static absl::StatusOr<PipelineCache> create(const Device& device);
  PipelineCache(PipelineCache&& other) noexcept;
  PipelineCache& operator=(PipelineCache&&) = delete;
  ~PipelineCache();

  // The pipeline of this SPIR-V with these constants. The SPIR-V must keep its address.
  absl::StatusOr<VkPipeline> get(std::span<const uint32_t> spirv, const Constants& constants);

  // Destroys all pipelines if there are more than `limit`. Call while the device is idle.
  void trim(size_t limit);

  size_t size() const { return pipelines_.size(); }
  VkPipelineLayout layout() const { return layout_; }

 private:
  PipelineCache() = default;
  void destroy_pipelines();

  VkDevice device_ = VK_NULL_HANDLE;
  VkDescriptorSetLayout set_layout_ = VK_NULL_HANDLE;
  VkPipelineLayout layout_ = VK_NULL_HANDLE;
  std::map<std::pair<const uint32_t*, Constants>, VkPipeline> pipelines_;
};

}  // namespace candela
