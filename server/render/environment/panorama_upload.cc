#include "server/render/environment/panorama_upload.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_format.h"
#include "proto/candela/v1/settings.h"
#include "server/base/check.h"
#include "server/base/status_macros.h"
#include "server/render/plan/texture_layout.h"
#include "shaders/environment/environment_params.h"

namespace candela {

namespace {

constexpr uint32_t kPanoramaTexelBytes = 8;

absl::Status check_sizes(const FrameDesc& desc, uint64_t largest, uint64_t bytes,
                         uint64_t max_allocation_bytes, uint64_t budget_bytes) {
  if (largest > max_allocation_bytes) {
    return absl::ResourceExhaustedError(absl::StrFormat(
        "a %dx%d %s panorama needs a texture of %d bytes and this device allocates at most %d at once; send "
        "fewer pixels",
        desc.width, desc.height, v1::word_of(desc.format), largest, max_allocation_bytes));
  }
  if (bytes > budget_bytes) {
    return absl::ResourceExhaustedError(absl::StrFormat(
        "a %dx%d %s panorama needs %d bytes of textures while it arrives and the memory budget is %d; send "
        "fewer pixels or raise --memory-budget",
        desc.width, desc.height, v1::word_of(desc.format), bytes, budget_bytes));
  }
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<PanoramaUpload> PanoramaUpload::take(TexturePool& pool, const DeviceSummary& device,
                                                    const FrameDesc& desc) {
  if (desc.width == 0 || desc.height == 0) {
    return absl::InvalidArgumentError(
        absl::StrFormat("panorama is %dx%d pixels; both sides must be at least 1", desc.width, desc.height));
  }
  PanoramaUpload upload;
  upload.desc_ = desc;
  upload.pitch_ = groups(desc.width, shader::GROUP_TEXELS) * shader::GROUP_TEXELS;
  TextureKey wire = {upload.pitch_, desc.height, bytes_per_pixel(desc.format)};
  const TextureKey panorama = {upload.pitch_, desc.height, kPanoramaTexelBytes};
  const uint64_t bytes = wire.bytes() * (device.unified_memory ? 1 : 2) + panorama.bytes();
  RETURN_IF_ERROR(check_sizes(desc, std::max(wire.bytes(), panorama.bytes()), bytes,
                              device.max_allocation_bytes, pool.budget_bytes()));
  const auto take_one = [&](const TextureKey& key, TexturePool::Lease* lease) {
    absl::StatusOr<TexturePool::Lease> taken =
        pool.take(key, upload.panorama_.bytes() + upload.wire_.bytes());
    if (taken.ok()) *lease = *std::move(taken);
    return taken.status();
  };
  RETURN_IF_ERROR(take_one(panorama, &upload.panorama_));
  RETURN_IF_ERROR(take_one(wire, &upload.wire_));
  if (device.unified_memory) return upload;
  wire.use = MemoryUse::kUpload;
  RETURN_IF_ERROR(take_one(wire, &upload.staged_));
  return upload;
}

std::span<std::byte> PanoramaUpload::row(uint32_t y) {
  CHECK(y < desc_.height);
  const Buffer& host = staged_ ? staged_.buffer() : wire_.buffer();
  const uint64_t pitch_bytes = uint64_t{pitch_} * bytes_per_pixel(desc_.format);
  return {host.mapped() + y * pitch_bytes, desc_.row_bytes()};
}

uint64_t PanoramaUpload::bytes() const { return wire_.bytes() + staged_.bytes() + panorama_.bytes(); }

}  // namespace candela
