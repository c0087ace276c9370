// Bakes panoramas into cubes on the Vulkan device, in passes that let others in between, and draws views
// there.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "absl/functional/function_ref.h"
#include "absl/status/statusor.h"
#include "server/base/crew.h"
#include "server/render/device/submissions.h"
#include "server/render/environment/environment.h"
#include "server/render/environment/view.h"
#include "server/render/frame/frame_memory.h"
#include "server/render/frame/texture_pool.h"
#include "server/render/settings/settings.h"
#include "server/vulkan/pipeline.h"
#include "server/vulkan/recorder.h"
#include "shaders/environment/environment_params.h"

namespace candela {

// Passes that may take seconds, as submissions of a few hundredths of a second. Internal to server/render.

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

// The memory of a panorama while its pixels arrive.
//
// Taken from the pool, and given back to it on destruction. Movable. One thread at a time.
class PanoramaUpload {
 public:
  // Allocates everything or nothing. RESOURCE_EXHAUSTED if the device or the pool's budget can never hold it,
  // before anything is allocated; otherwise fails as TexturePool::take() does. `pool` outlives the memory.
  static absl::StatusOr<PanoramaUpload> take(TexturePool& pool, const DeviceSummary& device,
                                             const FrameDesc& desc);

  const FrameDesc& desc() const { return desc_; }
  // The memory for row y of the wire pixels: desc().row_bytes() bytes. Write each byte once and do not read
  // it.
  std::span<std::byte> row(uint32_t y);
  // Of the pool's budget, until the panorama is finished, and what an environment keeps of it.
  uint64_t bytes() const;
  uint64_t kept_bytes() const { return panorama_.bytes(); }

 private:
  friend class EnvironmentBaker;
  FrameDesc desc_;
  uint32_t pitch_ = 0;  // texels from row to row, of the wire's pixels and of the panorama
  TexturePool::Lease wire_;
  TexturePool::Lease staged_;  // only on a device without unified memory
  TexturePool::Lease panorama_;
};

// Bakes environments on the Vulkan device, and renders views of them there or on the host.
//
// One thread at a time, except take(), bake_bytes() and takes_long(). That thread goes through checkpoint()
// between submissions of about kSlice, and may render frames there. The device and the pool outlive the baker
// and its environments.
//
// UNAVAILABLE if the pool's budget does not hold the memory beside what is in use, or if the device is lost;
// RESOURCE_EXHAUSTED if the budget can never hold it.
class EnvironmentBaker {
 public:
  // `crew`, which outlives the baker, draws views on the host, in the textures that the device maps; null:
  // the device draws them. It has no other work while a view is rendered.
  static absl::StatusOr<std::unique_ptr<EnvironmentBaker>> create(Device& device, TexturePool& pool,
                                                                  Crew* crew = nullptr);

  // Whether render_view() may take longer than a slice. Any thread.
  static bool takes_long(const View& view, const FrameDesc& desc);

  // The memory for a panorama's pixels. Any thread.
  absl::StatusOr<PanoramaUpload> take(const FrameDesc& desc) const;
  // A part of the pool's budget for memory of the host. Any thread.
  absl::StatusOr<TexturePool::Lease> reserve(uint64_t bytes) const {
    return pool_.reserve(bytes, "the bake");
  }

  // Ingests the pixels. `matrix` takes the input primaries to Rec.709. If some light is beyond the largest
  // half, the panorama needs a texture of twice the size. Then `grow` is called first, with its bytes, and
  // may refuse. While the pool has no room for it, `free_one` is called to free something; it returns false
  // if there is nothing to free.
  absl::StatusOr<Environment> finish(
      PanoramaUpload upload, const std::optional<std::array<float, 9>>& matrix,
      absl::FunctionRef<absl::Status(uint64_t bytes)> grow = [](uint64_t) { return absl::OkStatus(); },
      absl::FunctionRef<bool()> free_one = [] { return false; });

  // L_lm, which the environment keeps.
  absl::StatusOr<Harmonics> radiance(Environment& environment);

  // The part of the pool's budget that bake() and the reads of its result take, and `host_bytes`.
  // INVALID_ARGUMENT for a bad size, RESOURCE_EXHAUSTED if the whole budget is less. Any thread.
  absl::StatusOr<uint64_t> bake_bytes(const Environment& environment, const BakeSpec& spec,
                                      uint64_t host_bytes = 0) const;
  absl::StatusOr<BakedCube> bake(const Environment& environment, const BakeSpec& spec);

  // Makes what views read, unless the environment has it in this quality. Views without objects read no
  // specular levels.
  absl::Status prepare_view(Environment& environment, const BakeQuality& quality, bool objects = true);
  // The format of the frames that views are drawn into: halves, or floats for an environment of floats.
  static v1::PixelFormat view_format(const Environment& environment) {
    return environment.floats ? v1::PIXEL_FORMAT_RGBA32F : v1::PIXEL_FORMAT_RGBA16F;
  }
  // Renders a view into the input of a frame of view_format(), in place of the wire's pixels.
  // FAILED_PRECONDITION without prepare_view(); otherwise fails as check_view() does.
  absl::Status render_view(Environment& environment, const View& view, FrameMemory& memory);

  // R, G and B of a face's texels, row by row, without the border.
  absl::StatusOr<std::vector<float>> read_face(const CubeLevels& levels, uint32_t level, uint32_t face);
  // Scale and bias of the BRDF table as halves, row by row, which the baker keeps.
  absl::StatusOr<std::span<const uint16_t>> brdf_table();
  // The stored panorama's texels, row by row without padding.
  absl::StatusOr<std::vector<std::array<float, 4>>> read_panorama(const Environment& environment);
  // The memory of the host that this takes for each texel.
  static constexpr uint64_t kReadTexelBytes = 8 + 4 * sizeof(float);

 private:
  EnvironmentBaker(Device& device, TexturePool& pool, Crew* crew, LongPasses passes);
  // Writes upload.panorama_, of floats or of halves, and counts what it finds.
  absl::StatusOr<shader::PanoramaCounts> run_panorama(const PanoramaUpload& upload,
                                                      const std::optional<std::array<float, 9>>& matrix,
                                                      bool floats);
  absl::Status make_level_0(const Environment& environment, const BakeSpec& spec, CubeLevels& chain);
  absl::Status make_chain(CubeLevels& chain);
  // Empty if `spec`, which has its size, has no specular levels behind level 0.
  absl::StatusOr<CubeLevels> make_specular(const BakeSpec& spec, const CubeLevels& chain);
  absl::Status draw_view(const Environment& environment, const View& view,
                         std::span<const shader::ViewObject> objects, const Buffer& scene,
                         FrameMemory& memory);

  Device& device_;
  TexturePool& pool_;
  Crew* const crew_;
  LongPasses passes_;
  std::vector<uint16_t> brdf_;
};

}  // namespace candela
