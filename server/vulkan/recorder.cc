#include "server/vulkan/recorder.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_format.h"
#include "server/base/check.h"
#include "server/base/status_macros.h"
#include "server/vulkan/functions.h"
#include "server/vulkan/pipeline.h"

namespace candela {

namespace {

// If the process was stopped for a while, its first wait may have timed out when it continues; only the
// second counts.
constexpr int kWaits = 2;

}  // namespace

absl::StatusOr<Recorder> Recorder::create(const Device& device) {
  Recorder r;
  r.device_ = &device;
  VkCommandPoolCreateInfo pool{};
  pool.sType = VK_STRUCTURE_TYPE_COMMAND_POOL_CREATE_INFO;
  pool.queueFamilyIndex = device.queue_family();
  CANDELA_VK(vkCreateCommandPool(device.handle(), &pool, nullptr, &r.pool_));
  VkCommandBufferAllocateInfo commands{};
  commands.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_ALLOCATE_INFO;
  commands.commandPool = r.pool_;
  commands.level = VK_COMMAND_BUFFER_LEVEL_PRIMARY;
  commands.commandBufferCount = 1;
  CANDELA_VK(vkAllocateCommandBuffers(device.handle(), &commands, &r.commands_));
  VkFenceCreateInfo fence{};
  fence.sType = VK_STRUCTURE_TYPE_FENCE_CREATE_INFO;
  CANDELA_VK(vkCreateFence(device.handle(), &fence, nullptr, &r.fence_));
  if (device.timestamp_mask() != 0) {
    VkQueryPoolCreateInfo queries{};
    queries.sType = VK_STRUCTURE_TYPE_QUERY_POOL_CREATE_INFO;
    queries.queryType = VK_QUERY_TYPE_TIMESTAMP;
    queries.queryCount = kMaxMarks + 1;
    CANDELA_VK(vkCreateQueryPool(device.handle(), &queries, nullptr, &r.queries_));
  }
  return r;
}

Recorder::Recorder(Recorder&& other) noexcept
    : device_(other.device_),
      pool_(std::exchange(other.pool_, VK_NULL_HANDLE)),
      commands_(other.commands_),
      fence_(std::exchange(other.fence_, VK_NULL_HANDLE)),
      queries_(std::exchange(other.queries_, VK_NULL_HANDLE)) {}

Recorder::~Recorder() {
  if (queries_ != VK_NULL_HANDLE) vkDestroyQueryPool(device_->handle(), queries_, nullptr);
  if (fence_ != VK_NULL_HANDLE) vkDestroyFence(device_->handle(), fence_, nullptr);
  if (pool_ != VK_NULL_HANDLE) vkDestroyCommandPool(device_->handle(), pool_, nullptr);
}

absl::Status Recorder::usable() const {
  if (!device_->hung()) return absl::OkStatus();
  return absl::UnavailableError(
      absl::StrFormat("the Vulkan device %s hangs: it did not answer within %s; use another server",
                      device_->summary().name, absl::FormatDuration(device_->hang_limit())));
}

absl::Status Recorder::begin() {
  RETURN_IF_ERROR(usable());
  marks_.clear();
  ticks_.clear();
  CANDELA_VK(vkResetCommandPool(device_->handle(), pool_, 0));
  VkCommandBufferBeginInfo info{};
  info.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO;
  info.flags = VK_COMMAND_BUFFER_USAGE_ONE_TIME_SUBMIT_BIT;
  CANDELA_VK(vkBeginCommandBuffer(commands_, &info));
  if (queries_ != VK_NULL_HANDLE) vkCmdResetQueryPool(commands_, queries_, 0, kMaxMarks + 1);
  barrier();  // what earlier submissions wrote is visible to this one
  return absl::OkStatus();
}

void Recorder::mark(const char* name) {
  if (queries_ == VK_NULL_HANDLE || marks_.size() == kMaxMarks) return;
  vkCmdWriteTimestamp(commands_, VK_PIPELINE_STAGE_BOTTOM_OF_PIPE_BIT, queries_,
                      static_cast<uint32_t>(marks_.size()));
  marks_.push_back(name);
}

void Recorder::bind(VkPipeline pipeline, VkPipelineLayout layout, std::span<const VkBufferView> reads,
                    const VkDescriptorBufferInfo& written, const void* push, uint32_t push_bytes) {
  CHECK(reads.size() <= PipelineCache::kReads && push_bytes <= PipelineCache::kPushBytes);
  CHECK(written.range <= PipelineCache::kMaxWriteBytes &&
        written.offset % PipelineCache::kWriteAlignment == 0);
  vkCmdBindPipeline(commands_, VK_PIPELINE_BIND_POINT_COMPUTE, pipeline);
  VkWriteDescriptorSet writes[PipelineCache::kReads + 1] = {};
  auto count = static_cast<uint32_t>(reads.size());
  for (uint32_t i = 0; i < count; ++i) {
    writes[i].sType = VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET;
    writes[i].dstBinding = i;
    writes[i].descriptorCount = 1;
    writes[i].descriptorType = VK_DESCRIPTOR_TYPE_UNIFORM_TEXEL_BUFFER;
    writes[i].pTexelBufferView = &reads[i];
  }
  if (written.buffer != VK_NULL_HANDLE) {
    VkWriteDescriptorSet& write = writes[count++];
    write.sType = VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET;
    write.dstBinding = PipelineCache::kReads;
    write.descriptorCount = 1;
    write.descriptorType = VK_DESCRIPTOR_TYPE_STORAGE_BUFFER;
    write.pBufferInfo = &written;
  }
  device_->push_descriptors()(commands_, VK_PIPELINE_BIND_POINT_COMPUTE, layout, 0, count, writes);
  vkCmdPushConstants(commands_, layout, VK_SHADER_STAGE_COMPUTE_BIT, 0, push_bytes, push);
}

void Recorder::dispatch(uint32_t x0, uint32_t y0, uint32_t x1, uint32_t y1) {
  CHECK(x0 < x1 && y0 < y1);
  vkCmdDispatchBase(commands_, x0, y0, 0, x1 - x0, y1 - y0, 1);
}

void Recorder::fill_zero(const Buffer& buffer) { fill_zero(buffer, 0, VK_WHOLE_SIZE); }

void Recorder::fill_zero(const Buffer& buffer, uint64_t offset, uint64_t bytes) {
  CHECK(offset < buffer.bytes() && (bytes == VK_WHOLE_SIZE || offset + bytes <= buffer.bytes()));
  vkCmdFillBuffer(commands_, buffer.handle(), offset, bytes, 0);
}

void Recorder::update(const Buffer& buffer, const void* data, uint64_t bytes) {
  CHECK(bytes % 4 == 0 && bytes <= buffer.bytes());
  constexpr uint64_t kMost = 65536;  // of one command
  const auto* const from = static_cast<const std::byte*>(data);
  for (uint64_t first = 0; first < bytes; first += kMost) {
    vkCmdUpdateBuffer(commands_, buffer.handle(), first, std::min(kMost, bytes - first), from + first);
  }
}

void Recorder::copy(const Buffer& from, const Buffer& to, uint64_t bytes) { copy_part(from, to, 0, bytes); }

void Recorder::copy_part(const Buffer& from, const Buffer& to, uint64_t offset, uint64_t bytes) {
  CHECK(offset + bytes <= std::min(from.bytes(), to.bytes()));
  const VkBufferCopy region{offset, offset, bytes};
  vkCmdCopyBuffer(commands_, from.handle(), to.handle(), 1, &region);
}

void Recorder::copy_from(const Buffer& from, uint64_t offset, const Buffer& to, uint64_t bytes) {
  CHECK(offset + bytes <= from.bytes() && bytes <= to.bytes());
  const VkBufferCopy region{offset, 0, bytes};
  vkCmdCopyBuffer(commands_, from.handle(), to.handle(), 1, &region);
}

void Recorder::barrier() {
  VkMemoryBarrier barrier{};
  barrier.sType = VK_STRUCTURE_TYPE_MEMORY_BARRIER;
  barrier.srcAccessMask = VK_ACCESS_SHADER_WRITE_BIT | VK_ACCESS_TRANSFER_WRITE_BIT;
  barrier.dstAccessMask = VK_ACCESS_SHADER_READ_BIT | VK_ACCESS_SHADER_WRITE_BIT |
                          VK_ACCESS_TRANSFER_READ_BIT | VK_ACCESS_TRANSFER_WRITE_BIT;
  constexpr VkPipelineStageFlags kStages =
      VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT | VK_PIPELINE_STAGE_TRANSFER_BIT;
  vkCmdPipelineBarrier(commands_, kStages, kStages, 0, 1, &barrier, 0, nullptr, 0, nullptr);
}

void Recorder::barrier_to_host() {
  VkMemoryBarrier barrier{};
  barrier.sType = VK_STRUCTURE_TYPE_MEMORY_BARRIER;
  barrier.srcAccessMask = VK_ACCESS_SHADER_WRITE_BIT | VK_ACCESS_TRANSFER_WRITE_BIT;
  barrier.dstAccessMask = VK_ACCESS_HOST_READ_BIT;
  vkCmdPipelineBarrier(commands_, VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT | VK_PIPELINE_STAGE_TRANSFER_BIT,
                       VK_PIPELINE_STAGE_HOST_BIT, 0, 1, &barrier, 0, nullptr, 0, nullptr);
}

absl::Status Recorder::submit_and_wait() {
  const absl::Status status =
      device_->lost() ? vulkan_status(VK_ERROR_DEVICE_LOST, "vkQueueSubmit") : submit_to_device();
  if (absl::IsUnavailable(status)) device_->lose();
  return status;
}

absl::Status Recorder::submit_to_device() {
  if (queries_ != VK_NULL_HANDLE) {
    vkCmdWriteTimestamp(commands_, VK_PIPELINE_STAGE_BOTTOM_OF_PIPE_BIT, queries_,
                        static_cast<uint32_t>(marks_.size()));
  }
  CANDELA_VK(vkEndCommandBuffer(commands_));
  VkSubmitInfo submit{};
  submit.sType = VK_STRUCTURE_TYPE_SUBMIT_INFO;
  submit.commandBufferCount = 1;
  submit.pCommandBuffers = &commands_;
  CANDELA_VK(vkResetFences(device_->handle(), 1, &fence_));
  if (!device_->next_hangs()) CANDELA_VK(vkQueueSubmit(device_->queue(), 1, &submit, fence_));
  const auto timeout_ns = static_cast<uint64_t>(absl::ToInt64Nanoseconds(device_->hang_limit() / kWaits));
  VkResult waited = VK_TIMEOUT;
  for (int i = 0; i < kWaits && waited == VK_TIMEOUT; ++i) {
    waited = vkWaitForFences(device_->handle(), 1, &fence_, VK_TRUE, timeout_ns);
  }
  if (waited != VK_SUCCESS && waited != VK_ERROR_DEVICE_LOST) {
    device_->found_hung();
    return usable();
  }
  RETURN_IF_ERROR(vulkan_status(waited, "vkWaitForFences"));
  if (queries_ != VK_NULL_HANDLE) {
    ticks_.resize(marks_.size() + 1);
    CANDELA_VK(vkGetQueryPoolResults(device_->handle(), queries_, 0, static_cast<uint32_t>(ticks_.size()),
                                     ticks_.size() * 8, ticks_.data(), 8,
                                     VK_QUERY_RESULT_64_BIT | VK_QUERY_RESULT_WAIT_BIT));
  }
  return absl::OkStatus();
}

std::vector<Recorder::Timing> Recorder::timings() const {
  std::vector<Timing> timings;
  for (size_t i = 0; i + 1 < ticks_.size(); ++i) {
    const uint64_t ticks = (ticks_[i + 1] - ticks_[i]) & device_->timestamp_mask();
    timings.push_back(
        {marks_[i], static_cast<uint64_t>(static_cast<double>(ticks) * device_->timestamp_period_ns())});
  }
  return timings;
}

}  // namespace candela
