#include "server/vulkan/pipeline.h"

#include <spirv-tools/optimizer.hpp>
#include <unordered_map>

#include "absl/cleanup/cleanup.h"
#include "server/base/check.h"
#include "server/base/status_macros.h"
#include "server/vulkan/functions.h"

namespace candela {
namespace {

// Puts the constants into the shader and removes the code that they rule out. Drivers may inline functions
// before they look at constants: lavapipe then compiles every curve of resolve.comp 24 times, which takes ten
// times as long.
absl::StatusOr<std::vector<uint32_t>> specialised(std::span<const uint32_t> spirv,
                                                  const Constants& constants) {
  std::unordered_map<uint32_t, std::vector<uint32_t>> values;
  for (uint32_t id = 0; id < constants.size(); ++id) values[id] = {constants[id]};
  spvtools::Optimizer optimizer(SPV_ENV_VULKAN_1_2);
  optimizer.RegisterPass(spvtools::CreateSetSpecConstantDefaultValuePass(values))
      .RegisterPass(spvtools::CreateFreezeSpecConstantValuePass())
      .RegisterPass(spvtools::CreateFoldSpecConstantOpAndCompositePass())
      .RegisterPass(spvtools::CreateDeadBranchElimPass())
      .RegisterPass(spvtools::CreateEliminateDeadFunctionsPass())
      .RegisterPass(spvtools::CreateEliminateDeadConstantPass());
  spvtools::OptimizerOptions options;
  options.set_run_validator(false);
  std::vector<uint32_t> result;
  if (optimizer.Run(spirv.data(), spirv.size(), &result, options)) return result;
  return absl::InternalError("a shader cannot be specialised");
}

}  // namespace

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
  CHECK(!spirv.empty());
  VkPipeline& pipeline = pipelines_[{spirv.data(), constants}];
  if (pipeline != VK_NULL_HANDLE) return pipeline;

  ASSIGN_OR_RETURN(const std::vector<uint32_t> code, specialised(spirv, constants));
  VkShaderModuleCreateInfo module_info{};
  module_info.sType = VK_STRUCTURE_TYPE_SHADER_MODULE_CREATE_INFO;
  module_info.codeSize = code.size() * sizeof(uint32_t);
  module_info.pCode = code.data();
  VkShaderModule module = VK_NULL_HANDLE;
  CANDELA_VK(vkCreateShaderModule(device_, &module_info, nullptr, &module));
  const absl::Cleanup destroy = [&] { vkDestroyShaderModule(device_, module, nullptr); };

  VkComputePipelineCreateInfo info{};
  info.sType = VK_STRUCTURE_TYPE_COMPUTE_PIPELINE_CREATE_INFO;
  info.flags = VK_PIPELINE_CREATE_DISPATCH_BASE_BIT;
  info.stage.sType = VK_STRUCTURE_TYPE_PIPELINE_SHADER_STAGE_CREATE_INFO;
  info.stage.stage = VK_SHADER_STAGE_COMPUTE_BIT;
  info.stage.module = module;
  info.stage.pName = "main";
  info.layout = layout_;
  CANDELA_VK(vkCreateComputePipelines(device_, VK_NULL_HANDLE, 1, &info, nullptr, &pipeline));
  return pipeline;
}

}  // namespace candela
