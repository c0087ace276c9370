#include "server/render/device/frame_memory.h"

#include <utility>

#include "absl/strings/str_format.h"
#include "server/render/reference/verify.h"

namespace candela {

absl::StatusOr<std::unique_ptr<FrameMemory::Parts>> take_parts(TexturePool& pool, const DeviceSummary& device,
                                                               const FrameDesc& desc,
                                                               const Settings& settings, Verify verify) {
  auto parts = std::make_unique<FrameMemory::Parts>();
  parts->desc = desc;
  parts->output_format = settings.output_format;
  parts->pitch = groups(desc.width, shader::GROUP_TEXELS) * shader::GROUP_TEXELS;
  parts->tiles_x = groups(desc.width, shader::TILE_TEXELS);
  parts->tiles_y = groups(desc.height, shader::TILE_TEXELS);

  struct Wanted {
    TexturePool::Lease* lease;
    TextureKey key;
  };
  const TextureKey input = {parts->pitch, desc.height, bytes_per_pixel(desc.format), MemoryUse::kDevice};
  const TextureKey output = {parts->pitch, desc.height, bytes_per_pixel(settings.output_format),
                             MemoryUse::kDevice};
  const TextureKey tiles = {parts->tiles_x, parts->tiles_y, sizeof(shader::TileRecord), MemoryUse::kDevice};
  std::vector<Wanted> wanted = {{&parts->input, input}, {&parts->output, output}, {&parts->tiles, tiles}};
  const MeteringSettings& metering = settings.exposure.metering;
  if (metering.weights == MeterWeights::kCenter) {
    wanted.push_back(
        {&parts->center_weights, {1u << shader::CENTER_STEPS_LOG2, 1, sizeof(uint32_t), MemoryUse::kDevice}});
  }
  TextureKey histogram;
  if (metering.statistic == MeterStatistic::kPercentile || metering.histogram) {
    parts->histogram_copies = groups(parts->tiles_x * parts->tiles_y, shader::HISTOGRAM_TILES);
    histogram = {shader::HISTOGRAM_BINS, parts->histogram_copies, sizeof(shader::HistogramBin),
                 MemoryUse::kDevice};
    wanted.push_back({&parts->histogram, histogram});
  }
  const auto staged = [](TextureKey key, MemoryUse use) {
    key.use = use;
    return key;
  };
  if (!device.unified_memory) {
    wanted.push_back({&parts->upload, staged(input, MemoryUse::kUpload)});
    wanted.push_back({&parts->readback, staged(output, MemoryUse::kReadback)});
    wanted.push_back({&parts->tiles_readback, staged(tiles, MemoryUse::kReadback)});
    if (parts->histogram_copies > 0) {
      wanted.push_back({&parts->histogram_readback, staged(histogram, MemoryUse::kReadback)});
    }
  }
  if (settings.bloom.intensity > 0) {
    parts->level_sizes = settings.bloom.kind == BloomKind::kGaussian
                             ? gaussian_level_sizes(desc.width, desc.height)
                             : bloom_level_sizes(desc.width, desc.height, settings.bloom.levels,
                                                 find_tier(settings.tier)->bloom_level_size);
    parts->levels.resize(parts->level_sizes.size());
    for (size_t i = 0; i < parts->levels.size(); ++i) {
      const LevelSize& size = parts->level_sizes[i];
      wanted.push_back({&parts->levels[i], {size.width, size.height, 4 * sizeof(float), MemoryUse::kDevice}});
    }
  }

  if (verify != Verify::kNo) {
    const TextureKey exact = {parts->pitch, desc.height, 4 * sizeof(float), MemoryUse::kDevice};
    wanted.push_back({&parts->exact, exact});
    if (!device.unified_memory) {
      wanted.push_back({&parts->exact_readback, staged(exact, MemoryUse::kReadback)});
      if (!parts->levels.empty()) {
        const LevelSize& size = parts->level_sizes[0];
        wanted.push_back(
            {&parts->level_readback, {size.width, size.height, 4 * sizeof(float), MemoryUse::kReadback}});
      }
    }
    if (verify == Verify::kWithMap) {
      wanted.push_back(
          {&parts->error_map, {desc.width, desc.height, sizeof(uint16_t), MemoryUse::kReadback}});
    }
  }

  // What can never fit is said now, before anything is taken or given up for it.
  const bool by_reference = verify != Verify::kNo || find_tier(settings.tier)->host_reference;
  const uint64_t reference_bytes = by_reference ? reference_bytes_of(desc, settings) : 0;
  uint64_t bytes = reference_bytes;
  for (const Wanted& w : wanted) {
    bytes += w.key.bytes();
    if (w.key.bytes() > device.max_allocation_bytes) {
      return absl::ResourceExhaustedError(absl::StrFormat(
          "a %dx%d %s frame needs a texture of %d bytes and this device takes at most %d; send fewer pixels",
          desc.width, desc.height, name(desc.format), w.key.bytes(), device.max_allocation_bytes));
    }
  }
  if (bytes > pool.budget_bytes()) {
    if (by_reference) {
      return absl::ResourceExhaustedError(
          absl::StrFormat("a %dx%d %s frame needs %d bytes to be rendered and verified and the memory budget "
                          "is %d; send fewer "
                          "pixels, do without verification or raise --memory-budget",
                          desc.width, desc.height, name(desc.format), bytes, pool.budget_bytes()));
    }
    return absl::ResourceExhaustedError(absl::StrFormat(
        "a %dx%d %s frame needs %d bytes of textures and the memory budget is %d; send fewer pixels or raise "
        "--memory-budget",
        desc.width, desc.height, name(desc.format), bytes, pool.budget_bytes()));
  }
  for (const Wanted& w : wanted) {
    absl::StatusOr<TexturePool::Lease> lease = pool.take(w.key);
    if (!lease.ok()) return lease.status();
    *w.lease = *std::move(lease);
  }
  if (reference_bytes > 0) {
    absl::StatusOr<TexturePool::Lease> lease = pool.reserve(reference_bytes);
    if (!lease.ok()) return lease.status();
    parts->reference = *std::move(lease);
  }
  parts->bytes = bytes;
  return parts;
}

FrameMemory::FrameMemory() = default;
FrameMemory::FrameMemory(FrameMemory&&) noexcept = default;
FrameMemory& FrameMemory::operator=(FrameMemory&&) noexcept = default;
FrameMemory::~FrameMemory() = default;

const FrameDesc& FrameMemory::desc() const { return parts_->desc; }

uint64_t FrameMemory::bytes() const { return parts_->bytes; }

std::span<std::byte> FrameMemory::input_row(uint32_t y) {
  const uint64_t pitch_bytes = uint64_t{parts_->pitch} * bytes_per_pixel(parts_->desc.format);
  return {parts_->host_input().mapped() + y * pitch_bytes, parts_->desc.row_bytes()};
}

std::span<const std::byte> FrameMemory::output_row(uint32_t y) const {
  const uint64_t texel_bytes = bytes_per_pixel(parts_->output_format);
  return {parts_->host_output().mapped() + y * parts_->pitch * texel_bytes, parts_->desc.width * texel_bytes};
}

std::span<const uint16_t> FrameMemory::error_map_row(uint32_t y) const {
  if (!parts_->error_map) return {};
  const auto* halves = reinterpret_cast<const uint16_t*>(parts_->error_map.buffer().mapped());
  return {halves + size_t{y} * parts_->desc.width, parts_->desc.width};
}

void FrameMemory::keep_output_only() {
  if (parts_ == nullptr) return;
  Parts& parts = *parts_;
  parts.input = {};
  parts.upload = {};
  parts.tiles = {};
  parts.tiles_readback = {};
  parts.histogram = {};
  parts.histogram_readback = {};
  parts.center_weights = {};
  parts.levels.clear();
  parts.exact = {};
  parts.exact_readback = {};
  parts.level_readback = {};
  parts.reference = {};
  if (parts.readback) parts.output = {};
}

bool FrameMemory::output_contiguous() const { return parts_->pitch == parts_->desc.width; }

}  // namespace candela
