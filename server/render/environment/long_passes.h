// Passes that may take seconds, as submissions of a few hundredths of a second. Internal to server/render.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "absl/status/statusor.h"
#include "server/render/device/pace.h"
#include "server/render/frame/texture_pool.h"
#include "server/vulkan/pipeline.h"
#include "server/vulkan/recorder.h"
#include "shaders/environment/environment_params.h"

namespace candela {

// Invocations in a row, each of which writes the same number of bytes behind the one before it.
struct LongPass {
  std::span<const uint32_t> spirv;
  Constants constants;
  std::vector<VkBufferView> reads;
  const Buffer* target = nullptr;
  uint64_t target_offset = 0;  // a multiple of PipelineCache::kWriteAlignment
  uint64_t invocations = 0;    // below 2^32
  uint32_t invocation_bytes = 16;
  double cost = 1.0;  // of an invocation, in look-ups
};

// One thread at a time, which goes through checkpoint() between submissions. The device and the pool outlive
// it. Everything fails as Recorder::submit_and_wait() and TexturePool::take() do.
class LongPasses {
 public:
  static absl::StatusOr<LongPasses> create(const Device& device, TexturePool& pool);

  // Runs a pass to its end. `params` has a shader::PassRange called `range`, which this sets.
  template <typename Params>
  absl::Status run(const LongPass& pass, Params params) {
    static_assert(sizeof params <= PipelineCache::kPushBytes);
    return run(pass, &params, sizeof params, params.range);
  }

  // Records steps 0 to steps - 1, as many at a time as fit into a submission. `spirv` says whose pace counts;
  // `cost` is a step's, in look-ups.
  struct Steps {
    std::span<const uint32_t> spirv;
    uint32_t count = 0;
    std::function<double(uint32_t step)> cost;
    std::function<absl::Status(uint32_t begin, uint32_t end)> record;
    uint32_t most = UINT32_MAX;  // steps of a submission
  };
  absl::Status run(const Steps& steps);

  // A new buffer of the device with these bytes, a multiple of 16.
  absl::StatusOr<TexturePool::Lease> upload(std::span<const std::byte> bytes);
  // Reads bytes of a kDevice buffer, in parts if its memory is not mapped.
  absl::Status read(const Buffer& from, uint64_t offset, std::span<std::byte> to);
  // The size of the staging copy that read() takes from the pool for `bytes` that are not mapped.
  static uint64_t staging_bytes(uint64_t bytes);
  absl::Status copy(const Buffer& from, const Buffer& to);
  absl::StatusOr<TexturePool::Lease> take(uint64_t bytes, MemoryUse use = MemoryUse::kDevice);

  PipelineCache& pipelines() { return pipelines_; }
  Recorder& recorder() { return recorder_; }

 private:
  LongPasses(TexturePool& pool, PipelineCache pipelines, Recorder recorder);
  absl::Status run(const LongPass& pass, void* params, uint32_t params_bytes, shader::PassRange& range);
  // Runs one submission, and learns the pace from its time.
  absl::Status submit(std::span<const uint32_t> spirv, double cost,
                      const std::function<absl::Status()>& record);

  TexturePool* pool_;
  PipelineCache pipelines_;
  Recorder recorder_;
  Pace pace_;  // of each shader, by the address of its code
};

}  // namespace candela
