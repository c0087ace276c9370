#include "server/render/environment/long_passes.h"

#include <algorithm>
#include <chrono>
#include <cstring>
#include <utility>

#include "server/base/check.h"
#include "server/base/slices.h"
#include "server/base/status_macros.h"

namespace candela {

namespace {

// Before the pace of a pass is known, a look-up counts as this slow. The software device takes 12 to 25 ns.
constexpr double kFirstPace = 60e-9;
// What is read at a time from memory that is not mapped.
constexpr uint64_t kReadBytes = uint64_t{16} << 20;
constexpr uint64_t kMaxGroups = 65535;  // that every device can run side by side

}  // namespace

LongPasses::LongPasses(TexturePool& pool, PipelineCache pipelines, Recorder recorder)
    : pool_(&pool), pipelines_(std::move(pipelines)), recorder_(std::move(recorder)), pace_(kFirstPace) {}

absl::StatusOr<LongPasses> LongPasses::create(const Device& device, TexturePool& pool) {
  ASSIGN_OR_RETURN(PipelineCache pipelines, PipelineCache::create(device));
  ASSIGN_OR_RETURN(Recorder recorder, Recorder::create(device));
  return LongPasses(pool, std::move(pipelines), std::move(recorder));
}

absl::Status LongPasses::submit(std::span<const uint32_t> spirv, double cost,
                                const std::function<absl::Status()>& record) {
  CHECK(cost > 0);
  checkpoint();
  RETURN_IF_ERROR(recorder_.begin());
  RETURN_IF_ERROR(record());
  recorder_.barrier_to_host();
  const auto begin = std::chrono::steady_clock::now();
  RETURN_IF_ERROR(recorder_.submit_and_wait());
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  pace_.learn(spirv.data(), cost, seconds);
  return absl::OkStatus();
}

absl::Status LongPasses::run(const LongPass& pass, void* params, uint32_t params_bytes,
                             shader::PassRange& range) {
  ASSIGN_OR_RETURN(const VkPipeline pipeline, pipelines_.get(pass.spirv, pass.constants));
  CHECK(pass.target_offset + pass.invocations * pass.invocation_bytes <= pass.target->bytes());
  constexpr uint64_t kGroup = shader::ENVIRONMENT_GROUP;
  const uint64_t most = std::min(kMaxGroups * kGroup, PipelineCache::kMaxWriteBytes / pass.invocation_bytes);
  for (uint64_t first = 0; first < pass.invocations;) {
    const auto groups = static_cast<uint64_t>(pace_.affordable(pass.spirv.data()) / (pass.cost * kGroup));
    const uint64_t count =
        std::min({std::max<uint64_t>(groups, 1) * kGroup, most / kGroup * kGroup, pass.invocations - first});
    const auto record = [&]() -> absl::Status {
      range = {static_cast<uint32_t>(first), static_cast<uint32_t>(count)};
      const VkDescriptorBufferInfo written = {pass.target->handle(),
                                              pass.target_offset + first * pass.invocation_bytes,
                                              count * pass.invocation_bytes};
      recorder_.bind(pipeline, pipelines_.layout(), pass.reads, written, params, params_bytes);
      recorder_.dispatch(0, 0, static_cast<uint32_t>((count + kGroup - 1) / kGroup), 1);
      return absl::OkStatus();
    };
    const double cost = pass.cost * static_cast<double>(count);
    RETURN_IF_ERROR(submit(pass.spirv, cost, record));
    first += count;
  }
  return absl::OkStatus();
}

absl::Status LongPasses::run(const Steps& steps) {
  for (uint32_t begin = 0; begin < steps.count;) {
    const double most = pace_.affordable(steps.spirv.data());
    double cost = steps.cost(begin);
    uint32_t end = begin + 1;
    while (end < steps.count && end - begin < steps.most && cost + steps.cost(end) <= most) {
      cost += steps.cost(end++);
    }
    const auto record = [&] { return steps.record(begin, end); };
    RETURN_IF_ERROR(submit(steps.spirv, cost, record));
    begin = end;
  }
  return absl::OkStatus();
}

absl::StatusOr<TexturePool::Lease> LongPasses::take(uint64_t bytes, MemoryUse use) {
  return pool_->take({static_cast<uint32_t>((bytes + 15) / 16), 1, 16, use});
}

absl::StatusOr<TexturePool::Lease> LongPasses::upload(std::span<const std::byte> bytes) {
  ASSIGN_OR_RETURN(TexturePool::Lease lease, take(bytes.size()));
  if (lease.buffer().mapped() != nullptr) {
    std::memcpy(lease.buffer().mapped(), bytes.data(), bytes.size());
    return lease;
  }
  ASSIGN_OR_RETURN(const TexturePool::Lease staged, take(bytes.size(), MemoryUse::kUpload));
  std::memcpy(staged.buffer().mapped(), bytes.data(), bytes.size());
  RETURN_IF_ERROR(copy(staged.buffer(), lease.buffer()));
  return lease;
}

absl::Status LongPasses::copy(const Buffer& from, const Buffer& to) {
  checkpoint();
  RETURN_IF_ERROR(recorder_.begin());
  recorder_.copy(from, to, std::min(from.bytes(), to.bytes()));
  recorder_.barrier_to_host();
  return recorder_.submit_and_wait();
}

uint64_t LongPasses::staging_bytes(uint64_t bytes) { return std::min(bytes, kReadBytes); }

absl::Status LongPasses::read(const Buffer& from, uint64_t offset, std::span<std::byte> to) {
  CHECK(offset + to.size() <= from.bytes());
  if (from.mapped() != nullptr) {
    std::memcpy(to.data(), from.mapped() + offset, to.size());
    return absl::OkStatus();
  }
  ASSIGN_OR_RETURN(const TexturePool::Lease staged, take(staging_bytes(to.size()), MemoryUse::kReadback));
  for (uint64_t first = 0; first < to.size(); first += kReadBytes) {
    checkpoint();
    const uint64_t part = std::min<uint64_t>(kReadBytes, to.size() - first);
    RETURN_IF_ERROR(recorder_.begin());
    recorder_.copy_from(from, offset + first, staged.buffer(), part);
    recorder_.barrier_to_host();
    RETURN_IF_ERROR(recorder_.submit_and_wait());
    std::memcpy(to.data() + first, staged.buffer().mapped(), part);
  }
  return absl::OkStatus();
}

}  // namespace candela
