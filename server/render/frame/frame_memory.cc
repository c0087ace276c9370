#include "server/render/frame/frame_memory.h"

#include <algorithm>
#include <cstring>
#include <utility>
#include <vector>

#include "absl/strings/str_format.h"
#include "proto/candela/v1/settings.h"
#include "server/base/check.h"
#include "server/base/status_macros.h"
#include "server/render/frame/frame_textures.h"
#include "server/render/plan/resize_plan.h"
#include "server/vulkan/device.h"
#include "shaders/params.h"

namespace candela {

namespace {

constexpr uint32_t kLevelTexelBytes = 4 * sizeof(float);
// Pixels that the passes make within a slice. The software device takes up to 25 ns for each with two
// threads, and the first frame of a size also waits for its memory's pages.
constexpr uint64_t kPixelsOfSlice = uint64_t{1} << 21;

// A texture that a frame needs, and the lease that holds it.
struct Wanted {
  TexturePool::Lease* lease;
  TextureKey key;
};

// Adds a texture, and on a device without unified memory a copy of it for the host.
void want(TextureKey key, TexturePool::Lease* lease, TexturePool::Lease* host_copy, MemoryUse host_use,
          const DeviceSummary& device, std::vector<Wanted>* wanted) {
  wanted->push_back({lease, key});
  if (device.unified_memory) return;
  key.use = host_use;
  wanted->push_back({host_copy, key});
}

TextureKey level_key(const LevelSize& size, MemoryUse use) {
  return {size.width, size.height, kLevelTexelBytes, use};
}

void want_for_rendering(const DeviceSummary& device, FrameTextures& t, std::vector<Wanted>* wanted) {
  const TextureLayout& layout = t.layout;
  const FrameDesc& desc = layout.desc;
  want({layout.pitch, desc.height, bytes_per_pixel(desc.format)}, &t.input, &t.upload, MemoryUse::kUpload,
       device, wanted);
  want({layout.image_pitch, layout.image.height, bytes_per_pixel(layout.output_format)}, &t.output,
       &t.readback, MemoryUse::kReadback, device, wanted);
  want({layout.tiles_x, layout.tiles_y, sizeof(shader::TileRecord)}, &t.tiles, &t.tiles_readback,
       MemoryUse::kReadback, device, wanted);
  if (layout.center_weights) {
    wanted->push_back({&t.center_weights, {1u << shader::CENTER_STEPS_LOG2, 1, sizeof(uint32_t)}});
  }
  if (layout.histogram_copies > 0) {
    want({shader::HISTOGRAM_SCRUB_BINS, layout.histogram_copies, sizeof(shader::HistogramBin)}, &t.histogram,
         &t.histogram_readback, MemoryUse::kReadback, device, wanted);
  }
  t.levels.resize(layout.level_sizes.size());
  for (size_t i = 0; i < t.levels.size(); ++i) {
    wanted->push_back({&t.levels[i], level_key(layout.level_sizes[i], MemoryUse::kDevice)});
  }
  if (!layout.resizes()) return;
  wanted->push_back({&t.resize_block, {layout.resize_pitch, layout.resize_rows, kLevelTexelBytes}});
  wanted->push_back({&t.scene, {layout.image_pitch, layout.image.height, kLevelTexelBytes}});
  const uint32_t weights = layout.image.height * most_taps(desc.height, layout.image.height) +
                           layout.image.width * most_taps(desc.width, layout.image.width);
  wanted->push_back({&t.resize_weights, {groups(weights, 4), 1, 4 * sizeof(float)}});
}

void want_for_verification(const DeviceSummary& device, Verify verify, FrameTextures& t,
                           std::vector<Wanted>* wanted) {
  if (verify == Verify::kNo) return;
  const TextureLayout& layout = t.layout;
  want({layout.image_pitch, layout.image.height, 4 * sizeof(float)}, &t.exact, &t.exact_readback,
       MemoryUse::kReadback, device, wanted);
  if (!device.unified_memory && !t.levels.empty()) {
    wanted->push_back({&t.level_readback, level_key(layout.level_sizes[0], MemoryUse::kReadback)});
  }
  if (verify == Verify::kWithMap) {
    wanted->push_back(
        {&t.error_map, {layout.image.width, layout.image.height, sizeof(uint16_t), MemoryUse::kReadback}});
  }
}

// "1920x1080 rgba16f frame", with its image if that has another size.
std::string words_of(const TextureLayout& layout) {
  const FrameDesc& desc = layout.desc;
  const std::string frame =
      absl::StrFormat("%dx%d %s frame", desc.width, desc.height, v1::word_of(desc.format));
  if (!layout.resizes()) return frame;
  return absl::StrFormat("%s with an image of %dx%d pixels", frame, layout.image.width, layout.image.height);
}

// Refuses what can never fit, before anything is taken or given up for it.
absl::Status check_sizes(const TextureLayout& layout, const std::vector<Wanted>& wanted, uint64_t bytes,
                         bool by_reference, uint64_t max_allocation_bytes, uint64_t budget_bytes) {
  for (const Wanted& w : wanted) {
    if (w.key.bytes() > max_allocation_bytes) {
      return absl::ResourceExhaustedError(absl::StrFormat(
          "a %s needs a texture of %d bytes and this device allocates at most %d at once; send fewer pixels",
          words_of(layout), w.key.bytes(), max_allocation_bytes));
    }
  }
  if (bytes <= budget_bytes) return absl::OkStatus();
  if (by_reference) {
    return absl::ResourceExhaustedError(absl::StrFormat(
        "a %s needs %d bytes with those of the float64 reference and the memory budget is %d; send fewer "
        "pixels, do without verification, max_error_codes and the tier reference, or raise --memory-budget",
        words_of(layout), bytes, budget_bytes));
  }
  return absl::ResourceExhaustedError(
      absl::StrFormat("a %s needs %d bytes of textures and the memory budget "
                      "is %d; send fewer pixels or raise --memory-budget",
                      words_of(layout), bytes, budget_bytes));
}

absl::Status take_all(TexturePool& pool, const std::vector<Wanted>& wanted, uint64_t reference_bytes,
                      FrameTextures& textures) {
  uint64_t taken = 0;
  for (const Wanted& w : wanted) {
    ASSIGN_OR_RETURN(*w.lease, pool.take(w.key, taken));
    taken += w.lease->bytes();
  }
  if (reference_bytes == 0) return absl::OkStatus();
  ASSIGN_OR_RETURN(textures.reference, pool.reserve(reference_bytes, "the float64 reference of the frame"));
  CHECK(taken + reference_bytes == textures.bytes);
  return absl::OkStatus();
}

bool may_use_reference(const TextureLayout& layout, Verify verify) {
  return verify != Verify::kNo || layout.by_reference || layout.may_need_reference;
}

uint64_t reference_bytes_of(const TextureLayout& layout, Verify verify) {
  return may_use_reference(layout, verify) ? layout.reference_bytes : 0;
}

// Lists what the frame needs and sets the sum of its bytes, or refuses what can never fit.
absl::Status plan_memory(const TexturePool& pool, const DeviceSummary& device, const TextureLayout& layout,
                         Verify verify, FrameTextures& textures, std::vector<Wanted>* wanted) {
  textures.layout = layout;
  want_for_rendering(device, textures, wanted);
  want_for_verification(device, verify, textures, wanted);
  textures.bytes = reference_bytes_of(layout, verify);
  for (const Wanted& w : *wanted) textures.bytes += w.key.bytes();
  return check_sizes(layout, *wanted, textures.bytes, may_use_reference(layout, verify),
                     device.max_allocation_bytes, pool.budget_bytes());
}

}  // namespace

absl::StatusOr<FrameMemory> FrameMemory::take(TexturePool& pool, const DeviceSummary& device,
                                              const TextureLayout& layout, Verify verify) {
  auto textures = std::make_unique<FrameTextures>();
  std::vector<Wanted> wanted;
  absl::Status status = plan_memory(pool, device, layout, verify, *textures, &wanted);
  if (status.ok()) status = take_all(pool, wanted, reference_bytes_of(layout, verify), *textures);
  if (!status.ok()) return status;
  FrameMemory memory;
  memory.textures_ = std::move(textures);
  return memory;
}

absl::StatusOr<uint64_t> FrameMemory::bytes_for(const TexturePool& pool, const DeviceSummary& device,
                                                const TextureLayout& layout, Verify verify) {
  FrameTextures textures;
  std::vector<Wanted> wanted;
  if (absl::Status status = plan_memory(pool, device, layout, verify, textures, &wanted); !status.ok()) {
    return status;
  }
  return textures.bytes;
}

FrameMemory::FrameMemory() = default;
FrameMemory::FrameMemory(FrameMemory&&) noexcept = default;
FrameMemory& FrameMemory::operator=(FrameMemory&&) noexcept = default;
FrameMemory::~FrameMemory() = default;

const FrameDesc& FrameMemory::desc() const { return textures_->layout.desc; }

const ImageSize& FrameMemory::image() const { return textures_->layout.image; }

bool FrameMemory::takes_long() const {
  if (textures_ == nullptr) return false;
  const FrameDesc& desc = textures_->layout.desc;
  const ImageSize& image = textures_->layout.image;
  return textures_->reference || textures_->exact || uint64_t{desc.width} * desc.height > kPixelsOfSlice ||
         uint64_t{image.width} * image.height > kPixelsOfSlice;
}

uint64_t FrameMemory::bytes() const { return textures_->bytes; }

std::span<std::byte> FrameMemory::input_row(uint32_t y) {
  const TextureLayout& layout = textures_->layout;
  CHECK(y < layout.desc.height);
  const uint64_t pitch_bytes = uint64_t{layout.pitch} * bytes_per_pixel(layout.desc.format);
  return {textures_->host_input().mapped() + y * pitch_bytes, layout.desc.row_bytes()};
}

std::span<const std::byte> FrameMemory::output_row(uint32_t y) const {
  const TextureLayout& layout = textures_->layout;
  CHECK(y < layout.image.height);
  const uint64_t texel_bytes = bytes_per_pixel(layout.output_format);
  return {textures_->host_output().mapped() + y * layout.image_pitch * texel_bytes,
          layout.image.width * texel_bytes};
}

bool FrameMemory::output_contiguous() const {
  return textures_->layout.image_pitch == textures_->layout.image.width;
}

std::span<const uint16_t> FrameMemory::error_map_row(uint32_t y) const {
  if (!textures_->error_map) return {};
  CHECK(y < textures_->layout.image.height);
  const auto* halves = reinterpret_cast<const uint16_t*>(textures_->error_map.buffer().mapped());
  const uint32_t width = textures_->layout.image.width;
  return {halves + size_t{y} * width, width};
}

void FrameMemory::share(ClientPixels pixels) { textures_->client = std::move(pixels); }

void FrameTextures::copy_rows(const ClientPixels& from, uint32_t first, uint32_t last) const {
  const uint64_t pitch_bytes = uint64_t{layout.pitch} * bytes_per_pixel(layout.desc.format);
  const uint64_t row_bytes = layout.desc.row_bytes();
  std::byte* const to = host_input().mapped();
  if (pitch_bytes == row_bytes && from.row_stride_bytes == row_bytes) {
    std::memcpy(to + first * row_bytes, from.rows + first * row_bytes, (last - first) * row_bytes);
    return;
  }
  for (uint64_t y = first; y < last; ++y) {
    std::memcpy(to + y * pitch_bytes, from.rows + y * from.row_stride_bytes, row_bytes);
  }
}

void FrameMemory::keep_output_only() {
  if (textures_ == nullptr) return;
  FrameTextures& all = *textures_;
  if (all.client.image != nullptr && !all.client_has_image) {
    std::byte* to = all.client.image;
    for (uint32_t y = 0; y < image().height; ++y) {
      const std::span<const std::byte> row = output_row(y);
      to = std::copy(row.begin(), row.end(), to);
    }
  }
  {
    FrameTextures kept;
    kept.layout = all.layout;
    kept.stage = FrameStage::kOutputOnly;
    kept.bytes = all.bytes;
    kept.claim = std::move(all.claim);
    kept.error_map = std::move(all.error_map);
    if (all.client.image != nullptr) {
      // The client has it.
    } else if (all.readback) {
      kept.readback = std::move(all.readback);
    } else {
      kept.output = std::move(all.output);
    }
    all = std::move(kept);
  }
  // Only after the pool has the others back: whom the claim lets in must find them there.
  const uint64_t kept_bytes = all.readback.bytes() + all.output.bytes() + all.error_map.bytes();
  CHECK(kept_bytes <= all.bytes);
  if (all.claim) all.claim->shrink(kept_bytes);
}

void FrameMemory::replace_output(uint64_t bytes) {
  FrameTextures& all = *textures_;
  CHECK(all.stage == FrameStage::kDrawn || all.stage == FrameStage::kOutputOnly);
  const uint64_t image_bytes = all.readback.bytes() + all.output.bytes();
  all.readback = TexturePool::Lease();
  all.output = TexturePool::Lease();
  if (all.claim) all.claim->shrink(std::min(bytes, image_bytes) + all.error_map.bytes());
}

void FrameMemory::account(std::unique_ptr<MemoryClaim> claim) {
  CHECK(textures_->claim == nullptr);
  textures_->claim = std::move(claim);
}

}  // namespace candela
