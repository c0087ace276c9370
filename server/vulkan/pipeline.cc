#include "server/vulkan/pipeline.h"

#include "absl/cleanup/cleanup.h"
#include "server/vulkan/result.h"

namespace candela {

absl::StatusOr<PipelineCache> PipelineCache::create(const Device& device) {
  PipelineCache cache;
  cache.device_ = device.handle();
  VkDescriptorSetLayoutBinding bindings[kReads + 1] = {};
  for (uint32_t i = 0; i < kReads; ++i) {
    bindings[i] = {i, VK_DESCRIPTOR_TYPE_UNIFORM_TEXEL_BUFFER, 1, VK_SHADER_STAGE_COMPUTE_BIT, nullptr};
  }
  bindings[kReads] = {kReads, VK_DESCRIPTOR_TYPE_STORAGE_BUFFER, 1, VK_SHADER_STAGE_COMPUTE_BIT, nullptr};
  VkDescriptorSetLayoutCreateInfo set_info{};
  set_info.sType = VK_STRUCTURE_TYPE_DESCRIPTOR_SET_LAYOUT_CREATE_INFO;
  set_info.flags = VK_DESCRIPTOR_SET_LAYOUT_CREATE_PUSH_DESCRIPTOR_BIT_KHR;
  set_info.bindingCount = kReads + 1;
  set_info.pBindings = bindings;
  CANDELA_VK(vkCreateDescriptorSetLayout(cache.device_, &set_info, nullptr, &cache.set_layout_));
  const VkPushConstantRange range{VK_SHADER_STAGE_COMPUTE_BIT, 0, kPushBytes};
  VkPipelineLayoutCreateInfo info{};
  info.sType = VK_STRUCTURE_TYPE_PIPELINE_LAYOUT_CREATE_INFO;
  info.setLayoutCount = 1;
  info.pSetLayouts = &cache.set_layout_;
  info.pushConstantRangeCount = 1;
  info.pPushConstantRanges = &range;
  CANDELA_VK(vkCreatePipelineLayout(cache.device_, &info, nullptr, &cache.layout_));
  return cache;
}

PipelineCache::PipelineCache(PipelineCache&& other) noexcept
    : device_(other.device_),
      set_layout_(std::exchange(other.set_layout_, VK_NULL_HANDLE)),
      layout_(std::exchange(other.layout_, VK_NULL_HANDLE)),
      pipelines_(std::exchange(other.pipelines_, {})) {}

void PipelineCache::destroy_pipelines() {
  for (const auto& [key, pipeline] : pipelines_) vkDestroyPipeline(device_, pipeline, nullptr);
  pipelines_.clear();
}

void PipelineCache::trim(size_t limit) {
  if (pipelines_.size() > limit) destroy_pipelines();
}

PipelineCache::~PipelineCache() {
  destroy_pipelines();
  if (layout_ != VK_NULL_HANDLE) vkDestroyPipelineLayout(device_, layout_, nullptr);
  if (set_layout_ != VK_NULL_HANDLE) vkDestroyDescriptorSetLayout(device_, set_layout_, nullptr);
}

absl::StatusOr<VkPipeline> PipelineCache::get(std::span<const uint32_t> spirv, const Constants& constants) {
  VkPipeline& pipeline = pipelines_[{spirv.data(), constants}];
  if (pipeline != VK_NULL_HANDLE) return pipeline;

  VkShaderModuleCreateInfo module_info{};
  module_info.sType = VK_STRUCTURE_TYPE_SHADER_MODULE_CREATE_INFO;
  module_info.codeSize = spirv.size_bytes();
  module_info.pCode = spirv.data();
  VkShaderModule module = VK_NULL_HANDLE;
  CANDELA_VK(vkCreateShaderModule(device_, &module_info, nullptr, &module));
  const absl::Cleanup destroy = [&] { vkDestroyShaderModule(device_, module, nullptr); };

  std::vector<VkSpecializationMapEntry> entries;
  for (uint32_t i = 0; i < constants.size(); ++i) entries.push_back({i, i * 4, 4});
  const VkSpecializationInfo specialisation{static_cast<uint32_t>(entries.size()), entries.data(),
                                            constants.size() * 4, constants.data()};
  VkComputePipelineCreateInfo info{};
  info.sType = VK_STRUCTURE_TYPE_COMPUTE_PIPELINE_CREATE_INFO;
  info.flags = VK_PIPELINE_CREATE_DISPATCH_BASE_BIT;
  info.stage.sType = VK_STRUCTURE_TYPE_PIPELINE_SHADER_STAGE_CREATE_INFO;
  info.stage.stage = VK_SHADER_STAGE_COMPUTE_BIT;
  info.stage.module = module;
  info.stage.pName = "main";
  info.stage.pSpecializationInfo = &specialisation;
  info.layout = layout_;
  CANDELA_VK(vkCreateComputePipelines(device_, VK_NULL_HANDLE, 1, &info, nullptr, &pipeline));
  return pipeline;
}

}  // namespace candela
