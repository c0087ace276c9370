#include "server/render/plan/texture_layout.h"

#include <algorithm>
#include <array>

#include "server/render/plan/resize_plan.h"
#include "server/render/settings/error_bound.h"
#include "server/render/settings/tiers.h"
#include "shaders/params.h"
#include "shaders/reference.h"

namespace candela {

namespace {

// The sizes that the settings' bloom has if its first level is of `level_size`.
std::vector<LevelSize> level_sizes(const FrameDesc& desc, const v1::Bloom& bloom, uint32_t level_size) {
  if (bloom.intensity() == 0) return {};
  return bloom.kind() == v1::Bloom::KIND_GAUSSIAN
             ? gaussian_level_sizes(desc.width, desc.height)
             : bloom_level_sizes(desc.width, desc.height, bloom.levels(), level_size);
}

// For all tiers that max_error_codes may choose.
TextureLayout layout_for_any(const FrameDesc& desc, const Settings& settings) {
  const std::span<const Tier> rows = tiers_in_question(desc, settings);
  const Tier* metered_as = rows.empty() ? &settings.tier() : &rows.back();
  if (metered_as->host_reference && rows.size() > 1) --metered_as;  // a row of the device
  TextureLayout layout = layout_textures(desc, settings.with_tier(metered_as->name));
  layout.may_need_reference = !rows.empty() && rows.back().host_reference;
  return layout;
}

// About 26 bytes a pixel.
uint64_t reference_bytes(const FrameDesc& desc, const v1::Bloom& bloom) {
  const uint64_t pixels = uint64_t{desc.width} * desc.height;
  uint64_t texels = 0;
  for (const LevelSize& level : level_sizes(desc, bloom, kWholeBloom)) {
    texels += uint64_t{level.width} * level.height;
  }
  // The errors beyond p99.9, the sums of rows, the rows in progress and the third Gaussian level: less than 2
  // bytes a pixel except in tiny frames.
  constexpr uint64_t kSmall = 1 << 16;
  return pixels * (4 * sizeof(float) + 2) + texels * sizeof(reference::Rgb) + kSmall;
}

// The light of the rows under the filter, in double, and the resized scene.
uint64_t reference_resize_bytes(const TextureLayout& layout) {
  if (!layout.resizes()) return 0;
  const uint64_t rows = std::min(layout.desc.height, most_taps(layout.desc.height, layout.image.height));
  return (rows + 1) * layout.desc.width * sizeof(std::array<double, 4>) +
         uint64_t{layout.image.width} * layout.image.height * sizeof(std::array<float, 4>);
}

// Texels of a row in whole groups.
uint32_t pitch_of(uint32_t width, uint32_t group) { return groups(width, group) * group; }

// Of a block of the resized frame: 8 MiB, which stay in a cache, or a few rows. A register of the host holds
// some texels of a row, or one texel of up to four rows.
constexpr uint32_t kResizeTexels = 1 << 19;
constexpr uint32_t kResizeRows = 4;
constexpr uint32_t kResizeColumns = 16;

}  // namespace

std::vector<LevelSize> bloom_level_sizes(uint32_t width, uint32_t height, uint32_t levels,
                                         uint32_t level_size) {
  std::vector<LevelSize> sizes = {{(width + 1) / 2, (height + 1) / 2}};
  while (sizes.size() < levels) {
    const LevelSize next = {(sizes.back().width + 1) / 2, (sizes.back().height + 1) / 2};
    if (std::min(next.width, next.height) < 2) break;
    sizes.push_back(next);
  }
  if (level_size == kWholeBloom) return sizes;
  if (sizes.size() == 1) return {{(width + 3) / 4, (height + 3) / 4}};
  return {sizes.begin() + 1, sizes.end()};
}

std::vector<LevelSize> gaussian_level_sizes(uint32_t width, uint32_t height) {
  return {2, {(width + 3) / 4, (height + 3) / 4}};
}

TextureLayout layout_textures(const FrameDesc& desc, const Settings& settings) {
  if (settings.tier_is_open()) return layout_for_any(desc, settings);
  const v1::Metering& metering = settings->exposure().metering();
  const v1::Bloom& bloom = settings->bloom();
  const Tier& tier = settings.tier();
  TextureLayout layout;
  layout.desc = desc;
  layout.output_format = settings->output_format();
  layout.pitch = pitch_of(desc.width, shader::GROUP_TEXELS);
  layout.image = image_size(*settings, desc);
  layout.image_pitch = pitch_of(layout.image.width, shader::GROUP_TEXELS);
  if (layout.image != ImageSize{desc.width, desc.height}) {
    layout.resize_pitch = pitch_of(desc.width, kResizeColumns);
    layout.resize_rows = pitch_of(
        std::clamp<uint32_t>(kResizeTexels / layout.resize_pitch, 1, layout.image.height), kResizeRows);
  }
  layout.tiles_x = groups(desc.width, shader::TILE_TEXELS);
  layout.tiles_y = groups(desc.height, shader::TILE_TEXELS);
  if (metering.statistic() == v1::Metering::STATISTIC_PERCENTILE || settings.wants_histogram()) {
    layout.histogram_copies = groups(layout.tiles_x * layout.tiles_y, shader::HISTOGRAM_TILES);
  }
  layout.center_weights = metering.weights() == v1::Metering::WEIGHTS_CENTER;
  layout.level_sizes = level_sizes(desc, bloom, tier.bloom_level_size);
  const bool gaussian = bloom.kind() == v1::Bloom::KIND_GAUSSIAN;
  layout.level_size = gaussian ? 4 : tier.bloom_level_size;
  layout.first_level_twice =
      !gaussian && tier.bloom_level_size != kWholeBloom && layout.level_sizes.size() > 1;
  layout.summed_levels =
      gaussian ? 1 : static_cast<uint32_t>(layout.level_sizes.size()) + layout.first_level_twice;
  layout.by_reference = tier.host_reference;
  layout.reference_bytes = reference_bytes(desc, bloom) + reference_resize_bytes(layout);
  return layout;
}

}  // namespace candela
