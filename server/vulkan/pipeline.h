// Compute pipelines of one device, made when they are first asked for.
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

// One thread at a time. The device outlives it. All shaders have one layout: push constants of at most
// kPushBytes, up to kReads texel buffers to read, as bindings 0.. of set 0, and a storage buffer to write, as
// binding kReads; these are pushed as well. What is added to from many sides is written by address.
class PipelineCache {
 public:
  static constexpr uint32_t kPushBytes = 128;
  static constexpr uint32_t kReads = 3;
  // What can be bound for writing at once on every device, and where it may begin.
  static constexpr uint64_t kMaxWriteBytes = uint64_t{1} << 27;
  static constexpr uint64_t kWriteAlignment = 256;

  static absl::StatusOr<PipelineCache> create(const Device& device);
  PipelineCache(PipelineCache&& other) noexcept;
  PipelineCache& operator=(PipelineCache&&) = delete;
  ~PipelineCache();

  // The pipeline of this SPIR-V, which must stay where it is, with these constants.
  absl::StatusOr<VkPipeline> get(std::span<const uint32_t> spirv, const Constants& constants);

  // Destroys all pipelines once there are more than `limit`. Call while the device is idle.
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
