// Bakes environments on the Vulkan device, and renders views of them there or on the host.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "absl/functional/function_ref.h"
#include "absl/status/statusor.h"
#include "server/base/crew.h"
#include "server/render/environment/environment.h"
#include "server/render/environment/long_passes.h"
#include "server/render/environment/panorama_upload.h"
#include "server/render/environment/view.h"
#include "server/render/frame/frame_memory.h"

namespace candela {

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
